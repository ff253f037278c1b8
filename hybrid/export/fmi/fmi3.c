/* The ship for FMI 3.0, co-simulation. The declarations are those of the standard. */

#include <stdbool.h>
#include <stdint.h>

#include "instance.h"

#if defined _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } Status;
typedef void (*Logger)(void *environment, Status status, const char *category, const char *text);
typedef void *Component;
typedef const uint32_t *References;

static Status fail(Instance *m, const char *text) {
    if (m && m->logger) ((Logger)m->logger)(m->environment, fmi3Error, "logStatusError", text);
    return fmi3Error;
}

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT Status fmi3SetDebugLogging(Component c, bool on, size_t n, const char *const categories[]) {
    (void)c, (void)on, (void)n, (void)categories;
    return fmi3OK;
}

EXPORT Component fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                             bool logging, bool events, bool early, References intermediate, size_t n,
                                             void *environment, Logger logger, void *update) {
    Instance *m;
    (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)intermediate, (void)n;
    (void)update;
    if (!name || !token || strcmp(token, TOKEN) != 0) return NULL;
    m = create(name);
    if (m) m->logger = (void *)logger, m->environment = environment;
    return m;
}

EXPORT Component fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources, bool visible,
                                              bool logging, void *environment, Logger logger) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)environment, (void)logger;
    return NULL;
}

EXPORT Component fmi3InstantiateScheduledExecution(const char *name, const char *token, const char *resources,
                                                   bool visible, bool logging, void *environment, Logger logger,
                                                   void *update, void *lock, void *unlock) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)environment, (void)logger;
    (void)update, (void)lock, (void)unlock;
    return NULL;
}

EXPORT void fmi3FreeInstance(Component c) { release(c); }

EXPORT Status fmi3EnterInitializationMode(Component c, bool given, double tolerance, double begin, bool has_end,
                                          double end) {
    (void)given, (void)tolerance, (void)has_end, (void)end;
    ((Instance *)c)->core.time = begin;
    ((Instance *)c)->core.phase = INITIALISING;
    return fmi3OK;
}

EXPORT Status fmi3ExitInitializationMode(Component c) {
    start(c);
    ((Instance *)c)->core.phase = STEPPING;
    return fmi3OK;
}

EXPORT Status fmi3Terminate(Component c) {
    ((Instance *)c)->core.phase = TERMINATED;
    return fmi3OK;
}

EXPORT Status fmi3Reset(Component c) {
    reset(c);
    return fmi3OK;
}

EXPORT Status fmi3GetFloat64(Component c, References r, size_t n, double value[], size_t values) {
    if (n != values) return fail(c, "every variable has one value");
    update_outputs(c);
    for (size_t i = 0; i < n; i++) {
        if (r[i] >= N_VALUES || is_boolean(r[i])) return fail(c, "there is no such variable of type Float64");
        value[i] = ((Instance *)c)->core.values[r[i]];
    }
    return fmi3OK;
}

EXPORT Status fmi3GetBoolean(Component c, References r, size_t n, bool value[], size_t values) {
    if (n != values) return fail(c, "every variable has one value");
    update_outputs(c);
    for (size_t i = 0; i < n; i++) {
        if (!is_boolean(r[i])) return fail(c, "there is no such variable of type Boolean");
        value[i] = ((Instance *)c)->core.values[r[i]] != 0.0;
    }
    return fmi3OK;
}

EXPORT Status fmi3SetFloat64(Component c, References r, size_t n, const double value[], size_t values) {
    if (n != values) return fail(c, "every variable has one value");
    for (size_t i = 0; i < n; i++) {
        if (is_boolean(r[i]) || !may_set(c, r[i])) return fail(c, "this variable cannot be set now");
        ((Instance *)c)->core.values[r[i]] = value[i];
    }
    return fmi3OK;
}

EXPORT Status fmi3SetBoolean(Component c, References r, size_t n, const bool value[], size_t values) {
    if (n != values) return fail(c, "every variable has one value");
    for (size_t i = 0; i < n; i++) {
        if (!is_boolean(r[i]) || !may_set(c, r[i])) return fail(c, "this variable cannot be set now");
        ((Instance *)c)->core.values[r[i]] = value[i] ? 1.0 : 0.0;
    }
    return fmi3OK;
}

#define NO_VARIABLES(kind, type)                                                                      \
    EXPORT Status fmi3Get##kind(Component c, References r, size_t n, type value[], size_t values) {       \
        (void)r, (void)value, (void)values;                                                           \
        return n ? fail(c, "there are no variables of type " #kind) : fmi3OK;                         \
    }                                                                                                 \
    EXPORT Status fmi3Set##kind(Component c, References r, size_t n, const type value[], size_t values) { \
        (void)r, (void)value, (void)values;                                                           \
        return n ? fail(c, "there are no variables of type " #kind) : fmi3OK;                         \
    }

typedef const char *String;
NO_VARIABLES(Float32, float)
NO_VARIABLES(Int8, int8_t)
NO_VARIABLES(UInt8, uint8_t)
NO_VARIABLES(Int16, int16_t)
NO_VARIABLES(UInt16, uint16_t)
NO_VARIABLES(Int32, int32_t)
NO_VARIABLES(UInt32, uint32_t)
NO_VARIABLES(Int64, int64_t)
NO_VARIABLES(UInt64, uint64_t)
NO_VARIABLES(String, String)

EXPORT Status fmi3GetBinary(Component c, References r, size_t n, size_t sizes[], const uint8_t *value[], size_t values) {
    (void)r, (void)sizes, (void)value, (void)values;
    return n ? fail(c, "there are no variables of type Binary") : fmi3OK;
}

EXPORT Status fmi3SetBinary(Component c, References r, size_t n, const size_t sizes[], const uint8_t *const value[],
                            size_t values) {
    (void)r, (void)sizes, (void)value, (void)values;
    return n ? fail(c, "there are no variables of type Binary") : fmi3OK;
}

EXPORT Status fmi3GetClock(Component c, References r, size_t n, bool value[]) {
    (void)r, (void)value;
    return n ? fail(c, "there are no clocks") : fmi3OK;
}

EXPORT Status fmi3SetClock(Component c, References r, size_t n, const bool value[]) {
    (void)r, (void)value;
    return n ? fail(c, "there are no clocks") : fmi3OK;
}

EXPORT Status fmi3GetFMUState(Component c, void **saved) {
    if (!*saved) *saved = malloc(sizeof(Core));
    if (!*saved) return fail(c, "there is no memory for a state");
    memcpy(*saved, &((Instance *)c)->core, sizeof(Core));
    return fmi3OK;
}

EXPORT Status fmi3SetFMUState(Component c, void *saved) {
    memcpy(&((Instance *)c)->core, saved, sizeof(Core));
    return fmi3OK;
}

EXPORT Status fmi3FreeFMUState(Component c, void **saved) {
    (void)c;
    free(*saved);
    *saved = NULL;
    return fmi3OK;
}

EXPORT Status fmi3SerializedFMUStateSize(Component c, void *saved, size_t *size) {
    (void)c, (void)saved;
    *size = sizeof(Core);
    return fmi3OK;
}

EXPORT Status fmi3SerializeFMUState(Component c, void *saved, uint8_t bytes[], size_t size) {
    if (size != sizeof(Core)) return fail(c, "the size of the state is another");
    memcpy(bytes, saved, size);
    return fmi3OK;
}

EXPORT Status fmi3DeserializeFMUState(Component c, const uint8_t bytes[], size_t size, void **saved) {
    if (size != sizeof(Core)) return fail(c, "the size of the state is another");
    if (!*saved) *saved = malloc(sizeof(Core));
    if (!*saved) return fail(c, "there is no memory for a state");
    memcpy(*saved, bytes, size);
    return fmi3OK;
}

EXPORT Status fmi3DoStep(Component c, double now, double duration, bool kept, bool *events, bool *terminate,
                         bool *early, double *reached) {
    Status status;
    (void)kept;
    ((Instance *)c)->core.time = now;
    status = advance(c, duration) ? fail(c, "the step has no finite result: the model does not hold here") : fmi3OK;
    *events = *terminate = *early = false;
    *reached = ((Instance *)c)->core.time;
    return status;
}

/* What only other kinds of FMUs do. */
#define ABSENT(name, ...)                                \
    EXPORT Status fmi3##name(Component c, __VA_ARGS__) { \
        return fail(c, "fmi3" #name " is not provided"); \
    }
#define ABSENT_WITHOUT_ARGUMENTS(name) \
    EXPORT Status fmi3##name(Component c) { return fail(c, "fmi3" #name " is not provided"); }

ABSENT_WITHOUT_ARGUMENTS(EnterEventMode)
ABSENT_WITHOUT_ARGUMENTS(EnterConfigurationMode)
ABSENT_WITHOUT_ARGUMENTS(ExitConfigurationMode)
ABSENT_WITHOUT_ARGUMENTS(EvaluateDiscreteStates)
ABSENT_WITHOUT_ARGUMENTS(EnterContinuousTimeMode)
ABSENT_WITHOUT_ARGUMENTS(EnterStepMode)
ABSENT(UpdateDiscreteStates, bool *a, bool *b, bool *d, bool *e, bool *f, double *g)
ABSENT(CompletedIntegratorStep, bool a, bool *b, bool *d)
ABSENT(SetTime, double a)
ABSENT(SetContinuousStates, const double a[], size_t b)
ABSENT(GetContinuousStateDerivatives, double a[], size_t b)
ABSENT(GetEventIndicators, double a[], size_t b)
ABSENT(GetContinuousStates, double a[], size_t b)
ABSENT(GetNominalsOfContinuousStates, double a[], size_t b)
ABSENT(GetNumberOfEventIndicators, size_t *a)
ABSENT(GetNumberOfContinuousStates, size_t *a)
ABSENT(GetNumberOfVariableDependencies, uint32_t a, size_t *b)
ABSENT(GetVariableDependencies, uint32_t a, size_t b[], uint32_t d[], size_t e[], int f[], size_t g)
ABSENT(GetDirectionalDerivative, References a, size_t b, References d, size_t e, const double f[], size_t g, double h[],
       size_t i)
ABSENT(GetAdjointDerivative, References a, size_t b, References d, size_t e, const double f[], size_t g, double h[],
       size_t i)
ABSENT(GetIntervalDecimal, References a, size_t b, double d[], int e[])
ABSENT(GetIntervalFraction, References a, size_t b, uint64_t d[], uint64_t e[], int f[])
ABSENT(GetShiftDecimal, References a, size_t b, double d[])
ABSENT(GetShiftFraction, References a, size_t b, uint64_t d[], uint64_t e[])
ABSENT(SetIntervalDecimal, References a, size_t b, const double d[])
ABSENT(SetIntervalFraction, References a, size_t b, const uint64_t d[], const uint64_t e[])
ABSENT(SetShiftDecimal, References a, size_t b, const double d[])
ABSENT(SetShiftFraction, References a, size_t b, const uint64_t d[], const uint64_t e[])
ABSENT(GetOutputDerivatives, References a, size_t b, const int32_t d[], double e[], size_t f)
ABSENT(ActivateModelPartition, uint32_t a, double b)
