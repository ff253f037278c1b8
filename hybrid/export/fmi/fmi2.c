/* The ship for FMI 2.0, co-simulation. The declarations are those of the standard. */

#include "instance.h"

#if defined _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } Status;
typedef void (*Logger)(void *environment, const char *name, Status status, const char *category, const char *text, ...);
typedef struct {
    Logger logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, Status);
    void *environment;
} Callbacks;

typedef void *Component;
typedef const unsigned int *References;

static Status fail(Instance *m, const char *text) {
    if (m && m->logger) ((Logger)m->logger)(m->environment, m->name, fmi2Error, "logStatusError", text);
    return fmi2Error;
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT Status fmi2SetDebugLogging(Component c, int on, size_t n, const char *const categories[]) {
    (void)c, (void)on, (void)n, (void)categories;
    return fmi2OK;
}

EXPORT Component fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                                 const Callbacks *callbacks, int visible, int logging) {
    Instance *m;
    (void)resources, (void)visible, (void)logging;
    if (type != 1 || !name || !guid || strcmp(guid, TOKEN) != 0) return NULL;
    m = create(name);
    if (m && callbacks) m->logger = (void *)callbacks->logger, m->environment = callbacks->environment;
    return m;
}

EXPORT void fmi2FreeInstance(Component c) { release(c); }

EXPORT Status fmi2SetupExperiment(Component c, int given, double tolerance, double begin, int has_end, double end) {
    (void)given, (void)tolerance, (void)has_end, (void)end;
    ((Instance *)c)->core.time = begin;
    return fmi2OK;
}

EXPORT Status fmi2EnterInitializationMode(Component c) {
    ((Instance *)c)->core.phase = INITIALISING;
    return fmi2OK;
}

EXPORT Status fmi2ExitInitializationMode(Component c) {
    start(c);
    ((Instance *)c)->core.phase = STEPPING;
    return fmi2OK;
}

EXPORT Status fmi2Terminate(Component c) {
    ((Instance *)c)->core.phase = TERMINATED;
    return fmi2OK;
}

EXPORT Status fmi2Reset(Component c) {
    reset(c);
    return fmi2OK;
}

EXPORT Status fmi2GetReal(Component c, References r, size_t n, double value[]) {
    update_outputs(c);
    for (size_t i = 0; i < n; i++) {
        if (r[i] >= N_VALUES || is_boolean(r[i])) return fail(c, "there is no such real variable");
        value[i] = ((Instance *)c)->core.values[r[i]];
    }
    return fmi2OK;
}

EXPORT Status fmi2GetBoolean(Component c, References r, size_t n, int value[]) {
    update_outputs(c);
    for (size_t i = 0; i < n; i++) {
        if (!is_boolean(r[i])) return fail(c, "there is no such boolean variable");
        value[i] = ((Instance *)c)->core.values[r[i]] != 0.0;
    }
    return fmi2OK;
}

EXPORT Status fmi2GetInteger(Component c, References r, size_t n, int value[]) {
    (void)r, (void)value;
    return n ? fail(c, "there are no integer variables") : fmi2OK;
}

EXPORT Status fmi2GetString(Component c, References r, size_t n, const char *value[]) {
    (void)r, (void)value;
    return n ? fail(c, "there are no string variables") : fmi2OK;
}

EXPORT Status fmi2SetReal(Component c, References r, size_t n, const double value[]) {
    for (size_t i = 0; i < n; i++) {
        if (is_boolean(r[i]) || !may_set(c, r[i])) return fail(c, "this real variable cannot be set now");
        ((Instance *)c)->core.values[r[i]] = value[i];
    }
    return fmi2OK;
}

EXPORT Status fmi2SetBoolean(Component c, References r, size_t n, const int value[]) {
    for (size_t i = 0; i < n; i++) {
        if (!is_boolean(r[i]) || !may_set(c, r[i])) return fail(c, "this boolean variable cannot be set now");
        ((Instance *)c)->core.values[r[i]] = value[i] ? 1.0 : 0.0;
    }
    return fmi2OK;
}

EXPORT Status fmi2SetInteger(Component c, References r, size_t n, const int value[]) {
    (void)r, (void)value;
    return n ? fail(c, "there are no integer variables") : fmi2OK;
}

EXPORT Status fmi2SetString(Component c, References r, size_t n, const char *const value[]) {
    (void)r, (void)value;
    return n ? fail(c, "there are no string variables") : fmi2OK;
}

EXPORT Status fmi2GetFMUstate(Component c, void **saved) {
    if (!*saved) *saved = malloc(sizeof(Core));
    if (!*saved) return fail(c, "there is no memory for a state");
    memcpy(*saved, &((Instance *)c)->core, sizeof(Core));
    return fmi2OK;
}

EXPORT Status fmi2SetFMUstate(Component c, void *saved) {
    memcpy(&((Instance *)c)->core, saved, sizeof(Core));
    return fmi2OK;
}

EXPORT Status fmi2FreeFMUstate(Component c, void **saved) {
    (void)c;
    free(*saved);
    *saved = NULL;
    return fmi2OK;
}

EXPORT Status fmi2SerializedFMUstateSize(Component c, void *saved, size_t *size) {
    (void)c, (void)saved;
    *size = sizeof(Core);
    return fmi2OK;
}

EXPORT Status fmi2SerializeFMUstate(Component c, void *saved, char bytes[], size_t size) {
    if (size != sizeof(Core)) return fail(c, "the size of the state is another");
    memcpy(bytes, saved, size);
    return fmi2OK;
}

EXPORT Status fmi2DeSerializeFMUstate(Component c, const char bytes[], size_t size, void **saved) {
    if (size != sizeof(Core)) return fail(c, "the size of the state is another");
    if (!*saved) *saved = malloc(sizeof(Core));
    if (!*saved) return fail(c, "there is no memory for a state");
    memcpy(*saved, bytes, size);
    return fmi2OK;
}

EXPORT Status fmi2GetDirectionalDerivative(Component c, References unknown, size_t n, References known, size_t m,
                                           const double seed[], double result[]) {
    (void)unknown, (void)n, (void)known, (void)m, (void)seed, (void)result;
    return fail(c, "there are no directional derivatives");
}

EXPORT Status fmi2SetRealInputDerivatives(Component c, References r, size_t n, const int order[], const double value[]) {
    (void)r, (void)n, (void)order, (void)value;
    return fail(c, "inputs hold during a step");
}

EXPORT Status fmi2GetRealOutputDerivatives(Component c, References r, size_t n, const int order[], double value[]) {
    (void)r, (void)n, (void)order, (void)value;
    return fail(c, "there are no derivatives of outputs");
}

EXPORT Status fmi2DoStep(Component c, double now, double duration, int kept) {
    (void)kept;
    ((Instance *)c)->core.time = now;
    return advance(c, duration) ? fail(c, "the step has no finite result: the model does not hold here") : fmi2OK;
}

EXPORT Status fmi2CancelStep(Component c) { return fail(c, "no step is pending"); }

EXPORT Status fmi2GetStatus(Component c, int kind, Status *value) {
    (void)c, (void)kind;
    *value = fmi2OK;
    return fmi2OK;
}

EXPORT Status fmi2GetRealStatus(Component c, int kind, double *value) {
    (void)kind;
    *value = ((Instance *)c)->core.time;
    return fmi2OK;
}

EXPORT Status fmi2GetIntegerStatus(Component c, int kind, int *value) {
    (void)kind, (void)value;
    return fail(c, "there is no such status");
}

EXPORT Status fmi2GetBooleanStatus(Component c, int kind, int *value) {
    (void)kind;
    *value = ((Instance *)c)->core.phase == TERMINATED;
    return fmi2OK;
}

EXPORT Status fmi2GetStringStatus(Component c, int kind, const char **value) {
    (void)kind, (void)value;
    return fail(c, "there is no such status");
}
