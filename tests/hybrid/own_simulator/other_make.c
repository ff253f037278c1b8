/* The ship of sailer.txt as an FMU for co-simulation: compiled with -DFMI=2 or -DFMI=3.
   Only what a co-simulation of numbers needs of either standard is here. Forms of it: -DSTART_SI starts in SI units
   and radians, -DNO_RESET cannot be reset, -DSETTABLE goes on from where it is told at any time, and -DFIXED_S=0.1
   integrates in whole steps of that alone and leaves what remains of one for the next call. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { X, Y, YAW, U, V, R, N, DELTA, WIND_FROM, WIND, X0, Y0, YAW0, U0, V0, R0, MODE, SIZE };
typedef struct { double value[SIZE], left_s; } Ship;

static const double KNOT = 1852.0 / 3600.0, PI = 3.14159265358979323846;

static void start(Ship *ship) {
    for (int i = 0; i < 6; i++) ship->value[X + i] = ship->value[X0 + i];
#ifdef START_SI
    double *s = ship->value;
    s[U] /= KNOT; s[V] /= KNOT; s[YAW] *= 180.0 / PI; s[R] *= 180.0 / PI;
#endif
}

static int advance_by(Ship *ship, double dt) {
    double *s = ship->value;
    if (s[MODE] == 1.0 && s[U] > 20.0) return 3;                     /* an error */
    if (s[MODE] == 2.0 && s[U] > 20.0) for (;;) sleep(1);           /* hangs */
    if (s[MODE] == 3.0 && s[U] > 20.0) abort();                     /* dies */
    int count = (int)ceil(dt / 0.5 - 1e-9);
    count = count < 1 ? 1 : count;
    double h = dt / count;
    for (int k = 0; k < count; k++) {
        double psi = s[YAW] * PI / 180.0, from = s[WIND_FROM] * PI / 180.0;
        double ahead = -s[WIND] * cos(from - psi), port = -s[WIND] * sin(from - psi);
        double du = (1.8 * s[N] - 0.02 * s[U] * fabs(s[U]) - 0.05 * s[U] + 0.02 * (ahead - s[U])) / 8.0;
        double dv = (-0.8 * s[V] - 0.3 * s[U] * s[R] * PI / 180.0 + 0.04 * (port - s[V])) / 8.0;
        double dr = (-s[R] - 0.02 * s[R] * fabs(s[R]) + 0.015 * s[U] * s[DELTA]) / 6.0;
        s[X] += h * KNOT * (s[U] * cos(psi) - s[V] * sin(psi));
        s[Y] += h * KNOT * (s[U] * sin(psi) + s[V] * cos(psi));
        s[YAW] += h * s[R];
        s[U] += h * du; s[V] += h * dv; s[R] += h * dr;
    }
    return 0;
}

static int advance(Ship *ship, double dt) {
#ifdef FIXED_S
    for (ship->left_s += dt; ship->left_s > FIXED_S - 1e-9; ship->left_s -= FIXED_S)
        if (advance_by(ship, FIXED_S)) return 3;
    return 0;
#else
    return advance_by(ship, dt);
#endif
}

static Ship *make(void) {
    Ship *ship = calloc(1, sizeof(Ship));
    ship->value[U0] = 5.0;
    return ship;
}

static int put(Ship *ship, const unsigned *at, size_t n, const double *value) {
    for (size_t i = 0; i < n; i++) {
        ship->value[at[i]] = value[i];
#ifdef SETTABLE
        if (at[i] >= X0 && at[i] <= R0) ship->value[X + at[i] - X0] = value[i];
#endif
    }
    return 0;
}

static int take(Ship *ship, const unsigned *at, size_t n, double *value) {
    for (size_t i = 0; i < n; i++) value[i] = ship->value[at[i]];
    return 0;
}

static int again(Ship *ship) {
#ifdef NO_RESET
    return 3;
#endif
    memset(ship, 0, sizeof(Ship));
    ship->value[U0] = 5.0;
    return 0;
}

#if FMI == 2
const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
int fmi2SetDebugLogging(void *c, int on, size_t n, const char *const *names) { return 0; }
void *fmi2Instantiate(const char *name, int kind, const char *guid, const char *resources, const void *calls,
                      int visible, int logging) { return make(); }
void fmi2FreeInstance(void *c) { free(c); }
int fmi2SetupExperiment(void *c, int t, double tolerance, double begin, int e, double end) { return 0; }
int fmi2EnterInitializationMode(void *c) { return 0; }
int fmi2ExitInitializationMode(void *c) { start(c); return 0; }
int fmi2Terminate(void *c) { return 0; }
int fmi2Reset(void *c) { return again(c); }
int fmi2SetReal(void *c, const unsigned *at, size_t n, const double *v) { return put(c, at, n, v); }
int fmi2GetReal(void *c, const unsigned *at, size_t n, double *v) { return take(c, at, n, v); }
int fmi2DoStep(void *c, double t, double dt, int no_set) { return advance(c, dt); }
#define NONE2(name) int name(void) { return 3; }
NONE2(fmi2SetInteger) NONE2(fmi2SetBoolean) NONE2(fmi2SetString) NONE2(fmi2GetInteger) NONE2(fmi2GetBoolean)
NONE2(fmi2GetString) NONE2(fmi2GetFMUstate) NONE2(fmi2SetFMUstate) NONE2(fmi2FreeFMUstate)
NONE2(fmi2SerializedFMUstateSize) NONE2(fmi2SerializeFMUstate) NONE2(fmi2DeSerializeFMUstate)
NONE2(fmi2GetDirectionalDerivative) NONE2(fmi2SetRealInputDerivatives) NONE2(fmi2GetRealOutputDerivatives)
NONE2(fmi2CancelStep) NONE2(fmi2GetStatus) NONE2(fmi2GetRealStatus) NONE2(fmi2GetIntegerStatus)
NONE2(fmi2GetBooleanStatus) NONE2(fmi2GetStringStatus)
#else
#include <stdbool.h>
const char *fmi3GetVersion(void) { return "3.0"; }
int fmi3SetDebugLogging(void *c, bool on, size_t n, const char *const *names) { return 0; }
void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
    bool logging, bool events, bool early, const unsigned *needed, size_t n, void *environment, void *log,
    void *update) { return make(); }
void fmi3FreeInstance(void *c) { free(c); }
int fmi3EnterInitializationMode(void *c, bool t, double tolerance, double begin, bool e, double end) { return 0; }
int fmi3ExitInitializationMode(void *c) { start(c); return 0; }
int fmi3Terminate(void *c) { return 0; }
int fmi3Reset(void *c) { return again(c); }
int fmi3SetFloat64(void *c, const unsigned *at, size_t n, const double *v, size_t m) { return put(c, at, n, v); }
int fmi3GetFloat64(void *c, const unsigned *at, size_t n, double *v, size_t m) { return take(c, at, n, v); }
int fmi3DoStep(void *c, double t, double dt, bool no_set, bool *event, bool *end, bool *early, double *last) {
    *event = *end = *early = false;
    *last = t + dt;
    return advance(c, dt);
}
#define NONE3(name) int name(void) { return 3; }
NONE3(fmi3ActivateModelPartition) NONE3(fmi3CompletedIntegratorStep) NONE3(fmi3DeserializeFMUState)
NONE3(fmi3EnterConfigurationMode) NONE3(fmi3EnterContinuousTimeMode) NONE3(fmi3EnterEventMode)
NONE3(fmi3EnterStepMode) NONE3(fmi3EvaluateDiscreteStates) NONE3(fmi3ExitConfigurationMode)
NONE3(fmi3FreeFMUState) NONE3(fmi3GetAdjointDerivative) NONE3(fmi3GetBinary) NONE3(fmi3GetBoolean)
NONE3(fmi3GetClock) NONE3(fmi3GetContinuousStateDerivatives) NONE3(fmi3GetContinuousStates)
NONE3(fmi3GetDirectionalDerivative) NONE3(fmi3GetEventIndicators) NONE3(fmi3GetFMUState) NONE3(fmi3GetFloat32)
NONE3(fmi3GetInt16) NONE3(fmi3GetInt32) NONE3(fmi3GetInt64) NONE3(fmi3GetInt8) NONE3(fmi3GetIntervalDecimal)
NONE3(fmi3GetIntervalFraction) NONE3(fmi3GetNominalsOfContinuousStates) NONE3(fmi3GetNumberOfContinuousStates)
NONE3(fmi3GetNumberOfEventIndicators) NONE3(fmi3GetNumberOfVariableDependencies)
NONE3(fmi3GetOutputDerivatives) NONE3(fmi3GetShiftDecimal) NONE3(fmi3GetShiftFraction) NONE3(fmi3GetString)
NONE3(fmi3GetUInt16) NONE3(fmi3GetUInt32) NONE3(fmi3GetUInt64) NONE3(fmi3GetUInt8)
NONE3(fmi3GetVariableDependencies) NONE3(fmi3InstantiateModelExchange)
NONE3(fmi3InstantiateScheduledExecution) NONE3(fmi3SerializeFMUState) NONE3(fmi3SerializedFMUStateSize)
NONE3(fmi3SetBinary) NONE3(fmi3SetBoolean) NONE3(fmi3SetClock) NONE3(fmi3SetContinuousStates)
NONE3(fmi3SetFMUState) NONE3(fmi3SetFloat32) NONE3(fmi3SetInt16) NONE3(fmi3SetInt32) NONE3(fmi3SetInt64)
NONE3(fmi3SetInt8) NONE3(fmi3SetIntervalDecimal) NONE3(fmi3SetIntervalFraction) NONE3(fmi3SetShiftDecimal)
NONE3(fmi3SetShiftFraction) NONE3(fmi3SetString) NONE3(fmi3SetTime) NONE3(fmi3SetUInt16) NONE3(fmi3SetUInt32)
NONE3(fmi3SetUInt64) NONE3(fmi3SetUInt8) NONE3(fmi3UpdateDiscreteStates)
#endif
