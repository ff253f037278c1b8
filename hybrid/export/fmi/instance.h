/* One instance of the ship, whatever the version of FMI: its values by reference, its state, its steps.
   model.h has the sizes and start values of the ship, ship.c its equations. */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"

#define DEGREE 0.017453292519943295

int ship_start(const double **arg, double **res, long long int *iw, double *w, int mem);
int ship_start_work(long long int *sz_arg, long long int *sz_res, long long int *sz_iw, long long int *sz_w);
int ship_step(const double **arg, double **res, long long int *iw, double *w, int mem);
int ship_step_work(long long int *sz_arg, long long int *sz_res, long long int *sz_iw, long long int *sz_w);
int ship_outputs(const double **arg, double **res, long long int *iw, double *w, int mem);
int ship_outputs_work(long long int *sz_arg, long long int *sz_res, long long int *sz_iw, long long int *sz_w);

typedef enum { INSTANTIATED, INITIALISING, STEPPING, TERMINATED } Phase;

typedef struct { /* all that a saved state has */
    double values[N_VALUES], state[N_STATES], time;
    Phase phase;
} Core;

typedef struct {
    Core core;
    const double **arg;
    double **res, *w;
    long long int *iw;
    char *name;
    void *environment, *logger;
} Instance;

static long long int larger(long long int a, long long int b) { return a > b ? a : b; }

static void reset(Instance *m) {
    memset(&m->core, 0, sizeof(Core));
    memcpy(m->core.values, start_values, sizeof(start_values));
}

static void release(Instance *m) {
    if (!m) return;
    free(m->arg), free(m->res), free(m->iw), free(m->w), free(m->name), free(m);
}

static Instance *create(const char *name) {
    long long int a[4], b[4], c[4];
    Instance *m = calloc(1, sizeof(Instance));
    if (!m) return NULL;
    ship_step_work(a, a + 1, a + 2, a + 3);
    ship_outputs_work(b, b + 1, b + 2, b + 3);
    ship_start_work(c, c + 1, c + 2, c + 3);
    for (int i = 0; i < 4; i++) a[i] = larger(a[i], c[i]);
    m->arg = calloc(larger(a[0], b[0]) + 1, sizeof(double *));
    m->res = calloc(larger(a[1], b[1]) + 1, sizeof(double *));
    m->iw = calloc(larger(a[2], b[2]) + 1, sizeof(long long int));
    m->w = calloc(larger(a[3], b[3]) + 1, sizeof(double));
    m->name = calloc(strlen(name) + 1, 1);
    if (!m->arg || !m->res || !m->iw || !m->w || !m->name) {
        release(m);
        return NULL;
    }
    strcpy(m->name, name);
    reset(m);
    return m;
}

static int evaluate(Instance *m, int (*function)(const double **, double **, long long int *, double *, int),
                    double dt, double *result) {
    double orders[N_CONTROLS], wind[2], *v = m->core.values;
    for (int i = 0; i < N_CONTROLS; i++) orders[i] = v[VR_ORDERS + i] * control_unit[i];
    wind[0] = v[VR_WIND] * DEGREE, wind[1] = v[VR_WIND + 1];
    m->arg[0] = m->core.state, m->arg[1] = orders, m->arg[2] = wind, m->arg[3] = &dt, m->arg[4] = v + VR_DRIVES;
    m->arg[5] = v + VR_ACCELERATION, m->arg[6] = v + VR_NUMBERS, m->res[0] = result;
    return function(m->arg, m->res, m->iw, m->w, 0);
}

/* Before the first step the state is what the start values and the orders say. */
static void start(Instance *m) {
    double feedback[N_CONTROLS];
    if (m->core.phase >= STEPPING) return;
    evaluate(m, ship_start, 0.0, feedback);
    for (int i = 0; i < 6; i++) m->core.state[i] = m->core.values[VR_START + i] * pose_unit[i];
    for (int i = 6; i < N_STATES; i++) m->core.state[i] = feedback[(i - 6) % N_CONTROLS];
}

/* Outputs follow from the state: pose, speeds, the drives' feedback, forces, whether the model holds here. */
static void update_outputs(Instance *m) {
    double outputs[N_CONTROLS + 4], *v = m->core.values;
    start(m);
    evaluate(m, ship_outputs, 0.0, outputs);
    for (int i = 0; i < 6; i++) v[VR_POSE + i] = m->core.state[i] / pose_unit[i];
    for (int i = 0; i < N_CONTROLS; i++) v[VR_FEEDBACK + i] = outputs[i] / control_unit[i];
    for (int i = 0; i < 3; i++) v[VR_FORCES + i] = outputs[N_CONTROLS + i];
    v[VR_INSIDE] = outputs[N_CONTROLS + 3];
    v[VR_TIME] = m->core.time;
}

/* Steps of equal length, none longer than the internal one; 0, or 1 where the state is no number any more. */
static int advance(Instance *m, double duration) {
    double longest = m->core.values[VR_STEP], after[N_STATES];
    long steps = (long)ceil(duration / longest - 1e-9);
    if (!(duration >= 0.0) || !(longest > 0.0)) return 1;
    if (duration == 0.0) return 0;
    if (steps < 1) steps = 1;
    start(m);
    m->core.phase = STEPPING;
    for (long k = 0; k < steps; k++) {
        if (evaluate(m, ship_step, duration / (double)steps, after)) return 1;
        for (int i = 0; i < N_STATES; i++)
            if (!isfinite(after[i])) return 1;
        memcpy(m->core.state, after, sizeof(after));
    }
    m->core.time += duration;
    return 0;
}

/* Fixed parameters may be set before the first step, inputs at any time, outputs never. */
static int may_set(const Instance *m, unsigned int reference) {
    if (reference >= VR_ORDERS && reference < VR_POSE) return 1;
    return reference >= VR_START && reference < N_VALUES && m->core.phase < STEPPING;
}

static int is_boolean(unsigned int reference) { return reference == VR_INSIDE || reference == VR_DRIVES; }
