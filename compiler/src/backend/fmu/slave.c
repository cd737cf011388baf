/* The functions of FMI 2.0 for co-simulation, around the scene in scene.c. Nothing but this standard's own names is seen from
   outside. -DFMI2_FUNCTION_PREFIX=name_ puts `name_` before them, for who links many such units into one program. */

#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32) || defined(__CYGWIN__)
#define EXPORT __declspec(dllexport)
#elif defined(__GNUC__) && __GNUC__ >= 4
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif
#if defined(FMI2_FUNCTION_PREFIX) && !defined(FMI2_OVERRIDE_FUNCTION_PREFIX)
#define JOIN2(a, b) a##b
#define JOIN(a, b) JOIN2(a, b)
#define FMI(name) JOIN(FMI2_FUNCTION_PREFIX, name)
#else
#define FMI(name) name
#endif

/* The standard's types, as its headers have them. */
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef void *fmi2Component, *fmi2ComponentEnvironment, *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef const char *fmi2String;
typedef char fmi2Byte;
typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

/* Value references: the time, what is given at ports and as signals, what ports give, probes, the energy, ledgers. */
enum {
    GIVEN = 1,
    HELD = GIVEN + BOND_PORTS + BOND_INPUTS,
    PROBE = HELD + BOND_PORTS,
    ENERGY = PROBE + BOND_PROBES,
    LEDGER = ENERGY + 1,
    BOOKED = 6,
    END = LEDGER + BOND_REGIONS * BOOKED
};

/* What goes from communication point to communication point. */
typedef struct {
    bond_real saved[BOND_SAVED];
    double given[BOND_PORTS + BOND_INPUTS + 1]; /* what is given from outside, now */
    double gone[BOND_PORTS + 1];                /* its integral over what is over of the interval */
    double part;                                /* how much of the interval that is, s */
} memory;

enum { INSTANTIATED, INITIALIZING, RUNNING, TERMINATED };

typedef struct {
    bond_state scene;
    memory now; /* but for what is saved, which is in the scene */
    bond_real probes[BOND_PROBES + 1];
    int looked; /* whether these are those of the scene */
    int again;  /* whether inputs were set since the samples at t = 0 */
    int mode, logging;
    fmi2CallbackFunctions call;
    char name[128];
} slave;

static void *take(const fmi2CallbackFunctions *call, size_t size) {
    return call->allocateMemory ? call->allocateMemory(1, size) : calloc(1, size);
}

static void drop(const fmi2CallbackFunctions *call, void *what) {
    if (call->allocateMemory && call->freeMemory) call->freeMemory(what);
    else if (!call->allocateMemory) free(what);
}

static fmi2Status tell(const slave *s, fmi2Status status, const char *text) {
    if (s->call.logger && (s->logging || status >= fmi2Error)) {
        s->call.logger(s->call.componentEnvironment, s->name, status, status == fmi2Discard ? "logStatusDiscard" : "logStatusError", "%s", text);
    }
    return status;
}

static double time_of(const slave *s) { return bond_time(&s->scene) + s->now.part; }

static void begin(slave *s) {
    int i;
    bond_init(&s->scene);
    memset(&s->now, 0, sizeof s->now);
    memcpy(s->now.given, start_of, sizeof start_of);
    for (i = 0; i < BOND_INPUTS; ++i) bond_input(&s->scene, i, s->now.given[BOND_PORTS + i]);
    s->looked = s->again = 0;
    s->mode = INSTANTIATED;
}

#if FMU_BEGIN
int bond_begin(bond_state *b);
#endif

/* Takes the samples at t = 0 with the inputs that were set before the end of the initialization. */
static fmi2Status sampled(slave *s) {
#if FMU_BEGIN
    int i;
    if (!s->again) return fmi2OK;
    bond_init(&s->scene);
    for (i = 0; i < BOND_INPUTS; ++i) bond_input(&s->scene, i, s->now.given[BOND_PORTS + i]);
    if (bond_begin(&s->scene)) return tell(s, fmi2Discard, "with these inputs, the samples at t = 0 have no value");
#endif
    s->again = 0;
    return fmi2OK;
}

/* Ends the interval that runs. */
static int commit(slave *s) {
    bond_real moved[BOND_PORTS + 1];
    int i, failed;
    moved[BOND_PORTS] = 0;
    for (i = 0; i < BOND_PORTS; ++i) moved[i] = is_held[i] ? s->now.gone[i] : s->now.gone[i] / BOND_INTERVAL;
    failed = bond_commit(&s->scene, moved);
    if (!failed) {
        memset(s->now.gone, 0, sizeof s->now.gone);
        s->now.part = 0;
    }
    return failed;
}

EXPORT const char *FMI(fmi2GetTypesPlatform)(void) { return "default"; }
EXPORT const char *FMI(fmi2GetVersion)(void) { return "2.0"; }

EXPORT fmi2Status FMI(fmi2SetDebugLogging)(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    (void)n;
    (void)categories;
    if (!c) return fmi2Error;
    ((slave *)c)->logging = on;
    return fmi2OK;
}

EXPORT fmi2Component FMI(fmi2Instantiate)(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                          const fmi2CallbackFunctions *call, fmi2Boolean visible, fmi2Boolean logging) {
    slave *s, none;
    (void)resources;
    (void)visible;
    if (!call) return 0;
    memset(&none, 0, sizeof none);
    none.call = *call;
    strncpy(none.name, name ? name : "", sizeof none.name - 1);
    if (type != fmi2CoSimulation) {
        tell(&none, fmi2Error, "this unit is one for co-simulation");
        return 0;
    }
    if (!guid || strcmp(guid, FMU_GUID) != 0) {
        tell(&none, fmi2Error, "the GUID is not that of this unit: its modelDescription.xml is another one's");
        return 0;
    }
    s = take(call, sizeof *s);
    if (!s) {
        tell(&none, fmi2Error, "no memory for an instance");
        return 0;
    }
    s->call = *call;
    memcpy(s->name, none.name, sizeof none.name);
    s->logging = logging;
    begin(s);
    return s;
}

EXPORT void FMI(fmi2FreeInstance)(fmi2Component c) {
    fmi2CallbackFunctions call;
    if (!c) return;
    call = ((slave *)c)->call;
    drop(&call, c);
}

EXPORT fmi2Status FMI(fmi2SetupExperiment)(fmi2Component c, fmi2Boolean tolerant, fmi2Real tolerance, fmi2Real from,
                                           fmi2Boolean ends, fmi2Real to) {
    (void)tolerant;
    (void)tolerance;
    (void)ends;
    (void)to;
    if (!c) return fmi2Error;
    if (((slave *)c)->mode != INSTANTIATED) return tell(c, fmi2Error, "fmi2SetupExperiment: only before the initialization");
    if (from != 0) return tell(c, fmi2Error, "fmi2SetupExperiment: this unit starts at t = 0; let the simulation start there");
    return fmi2OK;
}

EXPORT fmi2Status FMI(fmi2EnterInitializationMode)(fmi2Component c) {
    if (!c) return fmi2Error;
    if (((slave *)c)->mode != INSTANTIATED) return tell(c, fmi2Error, "fmi2EnterInitializationMode: it is initialized; reset it first");
    ((slave *)c)->mode = INITIALIZING;
    return fmi2OK;
}

EXPORT fmi2Status FMI(fmi2ExitInitializationMode)(fmi2Component c) {
    if (!c) return fmi2Error;
    if (((slave *)c)->mode != INITIALIZING) return tell(c, fmi2Error, "fmi2ExitInitializationMode: it is not being initialized");
    if (sampled(c)) return fmi2Discard;
    ((slave *)c)->mode = RUNNING;
    return fmi2OK;
}

EXPORT fmi2Status FMI(fmi2Terminate)(fmi2Component c) {
    if (!c) return fmi2Error;
    ((slave *)c)->mode = TERMINATED;
    return fmi2OK;
}

EXPORT fmi2Status FMI(fmi2Reset)(fmi2Component c) {
    if (!c) return fmi2Error;
    begin(c);
    return fmi2OK;
}

EXPORT fmi2Status FMI(fmi2GetReal)(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    static const int booked[BOOKED] = { BOND_LEDGER_SUPPLIED, BOND_LEDGER_DISSIPATED, BOND_LEDGER_LEAKED, BOND_LEDGER_RESIDUAL,
                                        BOND_LEDGER_WORST, BOND_LEDGER_DEBT_MAX };
    slave *s = c;
    bond_real held[BOND_PORTS + 1];
    size_t i;
    if (!s || (n > 0 && (!vr || !value))) return fmi2Error;
    if (sampled(s)) return fmi2Discard;
    bond_output(&s->scene, held);
    held[BOND_PORTS] = 0;
    for (i = 0; i < n; ++i) {
        const fmi2ValueReference v = vr[i];
        if (v < GIVEN) value[i] = time_of(s);
        else if (v < HELD) value[i] = s->now.given[v - GIVEN];
        else if (v < PROBE) value[i] = held[v - HELD];
        else if (v < ENERGY) {
            if (!s->looked && bond_probes(&s->scene, s->probes)) return tell(s, fmi2Error, "fmi2GetReal: the probes have no value now");
            s->looked = 1;
            value[i] = s->probes[v - PROBE];
        } else if (v < LEDGER) value[i] = bond_energy(&s->scene);
        else if (v < END) {
            const int region = (int)(v - LEDGER) / BOOKED, k = (int)(v - LEDGER) % BOOKED;
            value[i] = bond_ledger(&s->scene, region, booked[k]);
            if (k < 3) value[i] += bond_ledger(&s->scene, region, booked[k] + 1); /* what rounding took from the sum */
        } else return tell(s, fmi2Error, "fmi2GetReal: there is no variable of this value reference");
    }
    return fmi2OK;
}

EXPORT fmi2Status FMI(fmi2SetReal)(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    slave *s = c;
    size_t i;
    if (!s || (n > 0 && (!vr || !value))) return fmi2Error;
    for (i = 0; i < n; ++i) {
        if (vr[i] < GIVEN || vr[i] >= HELD) return tell(s, fmi2Error, "fmi2SetReal: only inputs are set; build the unit with --set for other parameters");
        if (!isfinite(value[i])) return tell(s, fmi2Discard, "fmi2SetReal: an input that is not finite is not taken");
        s->now.given[vr[i] - GIVEN] = value[i];
        if (vr[i] >= GIVEN + BOND_PORTS) {
            bond_input(&s->scene, (int)(vr[i] - GIVEN) - BOND_PORTS, value[i]);
            s->looked = 0;
            /* A state that was put here may be a later one. */
            if (s->mode < RUNNING && time_of(s) == 0) s->again = 1;
        }
    }
    return fmi2OK;
}

EXPORT fmi2Status FMI(fmi2DoStep)(fmi2Component c, fmi2Real from, fmi2Real length, fmi2Boolean no_way_back) {
    slave *s = c;
    double left, slack;
    (void)no_way_back;
    if (!s) return fmi2Error;
    if (s->mode != RUNNING) return tell(s, fmi2Error, "fmi2DoStep: only after the initialization, and before the end");
    slack = 1e-6 * BOND_INTERVAL + 1e-12 * fabs(from);
    if (!(length > 0) || !isfinite(length)) return tell(s, fmi2Error, "fmi2DoStep: the step has no length");
    if (!(fabs(from - time_of(s)) <= slack)) return tell(s, fmi2Error, "fmi2DoStep: this unit stands at another communication point");
    s->looked = 0;
    for (;;) {
        double rest, step;
        int i, failed;
        left = from + length - time_of(s);
        if (left <= slack) return fmi2OK;
        rest = BOND_INTERVAL - s->now.part;
#if FMU_RUN
        if (s->now.part == 0 && left > 2 * BOND_INTERVAL) {
            const double many = floor(left / BOND_INTERVAL - 1);
            failed = bond_run(&s->scene, many < 1e6 ? (unsigned long)many : 1000000ul);
            if (!failed) continue;
        } else
#endif
        {
            const int ends = left >= rest - slack;
            step = ends ? rest : left;
            for (i = 0; i < BOND_PORTS; ++i) s->now.gone[i] += s->now.given[i] * step;
            s->now.part += step;
            if (!ends) return fmi2OK;
            failed = commit(s);
            if (failed) {
                for (i = 0; i < BOND_PORTS; ++i) s->now.gone[i] -= s->now.given[i] * step;
                s->now.part -= step;
            }
        }
        if (failed) {
            char text[256];
            sprintf(text, "fmi2DoStep: the interval that begins at t = %.17g s failed: %s", (double)bond_time(&s->scene),
                    failed > 0 && failed <= (int)(sizeof why / sizeof *why) ? why[failed - 1] : "");
            return tell(s, fmi2Discard, text);
        }
    }
}

EXPORT fmi2Status FMI(fmi2CancelStep)(fmi2Component c) { return c ? tell(c, fmi2Error, "fmi2CancelStep: steps are over when they return") : fmi2Error; }

EXPORT fmi2Status FMI(fmi2GetStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
    (void)kind;
    (void)value;
    return c ? fmi2Discard : fmi2Error;
}

EXPORT fmi2Status FMI(fmi2GetRealStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    if (!c || !value) return fmi2Error;
    if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = time_of(c);
    return fmi2OK;
}

EXPORT fmi2Status FMI(fmi2GetIntegerStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
    (void)kind;
    (void)value;
    return c ? fmi2Discard : fmi2Error;
}

EXPORT fmi2Status FMI(fmi2GetBooleanStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    if (!c || !value) return fmi2Error;
    if (kind != fmi2Terminated) return fmi2Discard;
    *value = 0;
    return fmi2OK;
}

EXPORT fmi2Status FMI(fmi2GetStringStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
    (void)kind;
    (void)value;
    return c ? fmi2Discard : fmi2Error;
}

/* The state of the scene, and how far it is in its interval. */
static void keep(const slave *s, memory *m) {
    *m = s->now;
    bond_save(&s->scene, m->saved);
}

static void put(slave *s, const memory *m) {
    s->now = *m;
    bond_restore(&s->scene, m->saved);
    s->looked = s->again = 0;
}

EXPORT fmi2Status FMI(fmi2GetFMUstate)(fmi2Component c, fmi2FMUstate *state) {
    slave *s = c;
    if (!s || !state) return fmi2Error;
    if (sampled(s)) return fmi2Discard;
    if (!*state) *state = take(&s->call, sizeof(memory));
    if (!*state) return tell(s, fmi2Error, "fmi2GetFMUstate: no memory");
    keep(s, *state);
    return fmi2OK;
}

EXPORT fmi2Status FMI(fmi2SetFMUstate)(fmi2Component c, fmi2FMUstate state) {
    if (!c || !state) return fmi2Error;
    put(c, state);
    return fmi2OK;
}

EXPORT fmi2Status FMI(fmi2FreeFMUstate)(fmi2Component c, fmi2FMUstate *state) {
    if (!c) return fmi2Error;
    if (state && *state) {
        drop(&((slave *)c)->call, *state);
        *state = 0;
    }
    return fmi2OK;
}

/* How many bytes come before those of a state: a digest (FNV-1a) of them and of the GUID. What another unit or nobody
   wrote does not have it. */
enum { SEAL = 8 };

static void seal(const fmi2Byte state[], fmi2Byte to[SEAL]) {
    const char *c;
    unsigned long long digest = 0xcbf29ce484222325ull;
    size_t i;
    for (c = FMU_GUID; *c; ++c) digest = (digest ^ (unsigned char)*c) * 0x100000001b3ull;
    for (i = 0; i < sizeof(memory); ++i) digest = (digest ^ (unsigned char)state[i]) * 0x100000001b3ull;
    for (i = 0; i < SEAL; ++i) to[i] = (fmi2Byte)(digest >> 8 * i & 0xff);
}

EXPORT fmi2Status FMI(fmi2SerializedFMUstateSize)(fmi2Component c, fmi2FMUstate state, size_t *size) {
    if (!c || !state || !size) return fmi2Error;
    *size = SEAL + sizeof(memory);
    return fmi2OK;
}

EXPORT fmi2Status FMI(fmi2SerializeFMUstate)(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    if (!c || !state || !bytes) return fmi2Error;
    if (size < SEAL + sizeof(memory)) return tell(c, fmi2Error, "fmi2SerializeFMUstate: the state does not fit");
    seal(state, bytes);
    memcpy(bytes + SEAL, state, sizeof(memory));
    return fmi2OK;
}

EXPORT fmi2Status FMI(fmi2DeSerializeFMUstate)(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    static const char *const other = "fmi2DeSerializeFMUstate: these bytes are no state of this unit, or were changed";
    slave *s = c;
    fmi2Byte own[SEAL];
    if (!s || !bytes || !state) return fmi2Error;
    if (size != SEAL + sizeof(memory)) return tell(s, fmi2Error, other);
    seal(bytes + SEAL, own);
    if (memcmp(bytes, own, SEAL) != 0) return tell(s, fmi2Error, other);
    if (!*state) *state = take(&s->call, sizeof(memory));
    if (!*state) return tell(s, fmi2Error, "fmi2DeSerializeFMUstate: no memory");
    memcpy(*state, bytes + SEAL, sizeof(memory));
    return fmi2OK;
}

EXPORT fmi2Status FMI(fmi2GetDirectionalDerivative)(fmi2Component c, const fmi2ValueReference of[], size_t n,
                                                    const fmi2ValueReference by[], size_t m, const fmi2Real dby[], fmi2Real dof[]) {
    (void)of;
    (void)n;
    (void)by;
    (void)m;
    (void)dby;
    (void)dof;
    return c ? tell(c, fmi2Error, "fmi2GetDirectionalDerivative: this unit has none") : fmi2Error;
}

EXPORT fmi2Status FMI(fmi2SetRealInputDerivatives)(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[],
                                                   const fmi2Real value[]) {
    (void)vr;
    (void)n;
    (void)order;
    (void)value;
    return c ? tell(c, fmi2Error, "fmi2SetRealInputDerivatives: inputs are constant over an interval") : fmi2Error;
}

EXPORT fmi2Status FMI(fmi2GetRealOutputDerivatives)(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[],
                                                    fmi2Real value[]) {
    (void)vr;
    (void)n;
    (void)order;
    (void)value;
    return c ? tell(c, fmi2Error, "fmi2GetRealOutputDerivatives: this unit has none") : fmi2Error;
}

/* There are numbers alone. */
#define NONE(name, type)                                                                                              \
    EXPORT fmi2Status FMI(name)(fmi2Component c, const fmi2ValueReference vr[], size_t n, type value[]) {             \
        (void)vr;                                                                                                     \
        (void)value;                                                                                                  \
        if (!c) return fmi2Error;                                                                                     \
        return n == 0 ? fmi2OK : tell(c, fmi2Error, #name ": all variables of this unit are Real");                   \
    }
NONE(fmi2GetInteger, fmi2Integer)
NONE(fmi2GetBoolean, fmi2Boolean)
NONE(fmi2GetString, fmi2String)
NONE(fmi2SetInteger, const fmi2Integer)
NONE(fmi2SetBoolean, const fmi2Boolean)
NONE(fmi2SetString, const fmi2String)
