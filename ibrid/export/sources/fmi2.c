/* FMI 2.0 for co-simulation and model exchange around the model in inverter.c; written by ibrid.
 *
 * Value references: 0, 1 the inputs v_D, v_Q; 2, 3 the outputs i_D, i_Q; then the states; then their derivatives;
 * then the constants of the operating point.
 * doStep takes a voltage that is held, or that goes in a straight line given by fmi2SetRealInputDerivatives.
 * The declarations below are the part of the FMI 2.0 standard that is needed, so that no header has to be found.
 * Compiled into a program of one's own, FMI2_FUNCTION_PREFIX goes in front of every name.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "inverter.c"

typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef const char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;
typedef struct {
    fmi2Boolean newDiscreteStatesNeeded;
    fmi2Boolean terminateSimulation;
    fmi2Boolean nominalsOfContinuousStatesChanged;
    fmi2Boolean valuesOfContinuousStatesChanged;
    fmi2Boolean nextEventTimeDefined;
    fmi2Real nextEventTime;
} fmi2EventInfo;

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORTED __attribute__((visibility("default")))
#else
#define EXPORTED
#endif
#ifdef FMI2_FUNCTION_PREFIX
#define JOIN(prefix, name) prefix##name
#define JOINED(prefix, name) JOIN(prefix, name)
#define FMI(name) JOINED(FMI2_FUNCTION_PREFIX, name)
#else
#define FMI(name) name
#endif

enum { FIRST_OUTPUT = 2, FIRST_STATE = 4, FIRST_DERIVATIVE = 4 + INVERTER_STATES, REFERENCES = 4 + 2 * INVERTER_STATES };
static const double AT_REST[] = INVERTER_AT_REST;

typedef struct {
    inverter model;
    double v[2];
    double slope[2];                                 /* of v, per second, during the next step */
    double time;
} deviation;

typedef struct {
    deviation now;
    fmi2CallbackFunctions callbacks;
    char *name;
} instance;

static fmi2Status refuse(const instance *one, const char *sentence)
{
    if (one->callbacks.logger)
        one->callbacks.logger(one->callbacks.componentEnvironment, one->name, fmi2Error, "logStatusError", sentence);
    return fmi2Error;
}

static void rest(deviation *now)
{
    static const double v0[2] = INVERTER_V_START;
    memset(now, 0, sizeof(deviation));
    inverter_reset(&now->model);
    memcpy(now->v, v0, sizeof v0);
}

EXPORTED const char *FMI(fmi2GetTypesPlatform)(void)
{
    return "default";
}

EXPORTED const char *FMI(fmi2GetVersion)(void)
{
    return "2.0";
}

EXPORTED fmi2Status FMI(fmi2SetDebugLogging)(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    (void)c, (void)on, (void)n, (void)categories;
    return fmi2OK;
}

EXPORTED fmi2Component FMI(fmi2Instantiate)(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                            const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean on)
{
    instance *one;
    (void)type, (void)resources, (void)visible, (void)on;
    if (!callbacks || !name || !guid)
        return NULL;
    one = calloc(1, sizeof(instance));
    if (!one)
        return NULL;
    rest(&one->now);
    one->callbacks = *callbacks;
    one->name = calloc(strlen(name) + 1, 1);
    if (one->name)
        strcpy(one->name, name);
    if (!one->name || strcmp(guid, INVERTER_GUID) != 0) {
        refuse(one, "the guid of modelDescription.xml must be that of the binary: export again");
        free(one->name);
        free(one);
        return NULL;
    }
    return one;
}

EXPORTED void FMI(fmi2FreeInstance)(fmi2Component c)
{
    instance *one = c;
    if (one) {
        free(one->name);
        free(one);
    }
}

EXPORTED fmi2Status FMI(fmi2SetupExperiment)(fmi2Component c, fmi2Boolean tolerant, fmi2Real tolerance, fmi2Real start,
                                             fmi2Boolean ends, fmi2Real stop)
{
    (void)tolerant, (void)tolerance, (void)ends, (void)stop;
    ((instance *)c)->now.time = start;
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2EnterInitializationMode)(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2ExitInitializationMode)(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2Terminate)(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2Reset)(fmi2Component c)
{
    rest(&((instance *)c)->now);
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2GetReal)(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    const instance *one = c;
    double i[2], dx[INVERTER_STATES];
    size_t k;
    inverter_output(&one->now.model, one->now.v, i);
    inverter_rates(&one->now.model, one->now.v, dx);
    for (k = 0; k < n; k++) {
        if (vr[k] < FIRST_OUTPUT)
            value[k] = one->now.v[vr[k]];
        else if (vr[k] < FIRST_STATE)
            value[k] = i[vr[k] - FIRST_OUTPUT];
        else if (vr[k] < FIRST_DERIVATIVE)
            value[k] = one->now.model.x[vr[k] - FIRST_STATE];
        else if (vr[k] < REFERENCES)
            value[k] = dx[vr[k] - FIRST_DERIVATIVE];
        else if (vr[k] < REFERENCES + sizeof AT_REST / sizeof *AT_REST)
            value[k] = AT_REST[vr[k] - REFERENCES];
        else
            return refuse(one, "fmi2GetReal: there is no real variable with that value reference");
    }
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2SetReal)(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    instance *one = c;
    size_t k;
    for (k = 0; k < n; k++) {
        if (vr[k] < FIRST_OUTPUT)
            one->now.v[vr[k]] = value[k];
        else if (vr[k] >= FIRST_STATE && vr[k] < FIRST_DERIVATIVE)
            one->now.model.x[vr[k] - FIRST_STATE] = value[k];
        else
            return refuse(one, "fmi2SetReal: only v_D, v_Q and the states can be set");
    }
    return fmi2OK;
}

#define NONE_OF_THIS_TYPE(name, value_type)                                                                            \
    EXPORTED fmi2Status FMI(name)(fmi2Component c, const fmi2ValueReference vr[], size_t n, value_type value[])         \
    {                                                                                                                  \
        (void)vr, (void)value;                                                                                         \
        return n ? refuse(c, #name ": all variables are real") : fmi2OK;                                               \
    }
NONE_OF_THIS_TYPE(fmi2GetInteger, fmi2Integer)
NONE_OF_THIS_TYPE(fmi2GetBoolean, fmi2Boolean)
NONE_OF_THIS_TYPE(fmi2GetString, fmi2String)
NONE_OF_THIS_TYPE(fmi2SetInteger, const fmi2Integer)
NONE_OF_THIS_TYPE(fmi2SetBoolean, const fmi2Boolean)
NONE_OF_THIS_TYPE(fmi2SetString, const fmi2String)

/* saved states */

EXPORTED fmi2Status FMI(fmi2GetFMUstate)(fmi2Component c, fmi2FMUstate *state)
{
    if (!*state)
        *state = malloc(sizeof(deviation));
    if (!*state)
        return refuse(c, "fmi2GetFMUstate: out of memory");
    memcpy(*state, &((instance *)c)->now, sizeof(deviation));
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2SetFMUstate)(fmi2Component c, fmi2FMUstate state)
{
    memcpy(&((instance *)c)->now, state, sizeof(deviation));
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2FreeFMUstate)(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2SerializedFMUstateSize)(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    (void)c, (void)state;
    *size = sizeof(deviation);
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2SerializeFMUstate)(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    if (size < sizeof(deviation))
        return refuse(c, "fmi2SerializeFMUstate: the buffer is too small");
    memcpy(bytes, state, sizeof(deviation));
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2DeSerializeFMUstate)(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    if (size != sizeof(deviation))
        return refuse(c, "fmi2DeSerializeFMUstate: the bytes are not a state of this model");
    if (!*state)
        *state = malloc(sizeof(deviation));
    if (!*state)
        return refuse(c, "fmi2DeSerializeFMUstate: out of memory");
    memcpy(*state, bytes, sizeof(deviation));
    return fmi2OK;
}

/* A, B, C, D: each direction times the column of its variable */
EXPORTED fmi2Status FMI(fmi2GetDirectionalDerivative)(fmi2Component c, const fmi2ValueReference unknown[], size_t n,
                                                      const fmi2ValueReference known[], size_t m, const fmi2Real dknown[],
                                                      fmi2Real dunknown[])
{
    const instance *one = c;
    double i[2], dx[INVERTER_STATES], x_seed[INVERTER_STATES] = {0.0}, v_seed[2] = {0.0, 0.0};
    size_t k;
    for (k = 0; k < m; k++) {
        if (known[k] < FIRST_OUTPUT)
            v_seed[known[k]] = dknown[k];
        else if (known[k] >= FIRST_STATE && known[k] < FIRST_DERIVATIVE)
            x_seed[known[k] - FIRST_STATE] = dknown[k];
        else
            return refuse(c, "fmi2GetDirectionalDerivative: known are v_D, v_Q and the states");
    }
    inverter_tangent(&one->now.model, one->now.v, x_seed, v_seed, dx, i);
    for (k = 0; k < n; k++) {
        if (unknown[k] >= FIRST_OUTPUT && unknown[k] < FIRST_STATE)
            dunknown[k] = i[unknown[k] - FIRST_OUTPUT];
        else if (unknown[k] >= FIRST_DERIVATIVE && unknown[k] < REFERENCES)
            dunknown[k] = dx[unknown[k] - FIRST_DERIVATIVE];
        else
            return refuse(c, "fmi2GetDirectionalDerivative: unknown are i_D, i_Q and the derivatives of the states");
    }
    return fmi2OK;
}

/* co-simulation */

EXPORTED fmi2Status FMI(fmi2SetRealInputDerivatives)(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                                     const fmi2Integer order[], const fmi2Real value[])
{
    instance *one = c;
    size_t k;
    for (k = 0; k < n; k++) {
        if (vr[k] >= FIRST_OUTPUT || order[k] != 1)
            return refuse(one, "fmi2SetRealInputDerivatives: the first derivatives of v_D and v_Q can be set");
        one->now.slope[vr[k]] = value[k];
    }
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2GetRealOutputDerivatives)(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                                      const fmi2Integer order[], fmi2Real value[])
{
    (void)vr, (void)order, (void)value;
    return n ? refuse(c, "fmi2GetRealOutputDerivatives: not given by this model") : fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2DoStep)(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean keep)
{
    instance *one = c;
    deviation *now = &one->now;
    double after[2];
    int k;
    (void)keep;
    if (step == 0.0)
        return fmi2OK;
    if (step != now->model.step && inverter_set_step(&now->model, step) != 0)
        return refuse(one, "fmi2DoStep: the step must be above 0, and so short that an unstable model stays finite");
    for (k = 0; k < 2; k++)
        after[k] = now->v[k] + now->slope[k] * step;
    inverter_step(&now->model, now->v, after);
    memcpy(now->v, after, sizeof after);
    memset(now->slope, 0, sizeof now->slope);
    now->time = time + step;
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2CancelStep)(fmi2Component c)
{
    return refuse(c, "fmi2CancelStep: a step is never pending");
}

EXPORTED fmi2Status FMI(fmi2GetStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)c, (void)kind;
    *value = fmi2OK;
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2GetRealStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    (void)kind;
    *value = ((instance *)c)->now.time;
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2GetIntegerStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

EXPORTED fmi2Status FMI(fmi2GetBooleanStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    (void)c, (void)kind;
    *value = 0;
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2GetStringStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    (void)c, (void)kind;
    *value = "";
    return fmi2OK;
}

/* model exchange */

EXPORTED fmi2Status FMI(fmi2EnterEventMode)(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2NewDiscreteStates)(fmi2Component c, fmi2EventInfo *info)
{
    (void)c;
    memset(info, 0, sizeof(fmi2EventInfo));
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2EnterContinuousTimeMode)(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2CompletedIntegratorStep)(fmi2Component c, fmi2Boolean keep, fmi2Boolean *event,
                                                     fmi2Boolean *terminate)
{
    (void)c, (void)keep;
    *event = 0;
    *terminate = 0;
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2SetTime)(fmi2Component c, fmi2Real time)
{
    ((instance *)c)->now.time = time;
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2SetContinuousStates)(fmi2Component c, const fmi2Real x[], size_t n)
{
    if (n != INVERTER_STATES)
        return refuse(c, "fmi2SetContinuousStates: the number of states is another");
    memcpy(((instance *)c)->now.model.x, x, n * sizeof(double));
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2GetDerivatives)(fmi2Component c, fmi2Real derivatives[], size_t n)
{
    const instance *one = c;
    if (n != INVERTER_STATES)
        return refuse(c, "fmi2GetDerivatives: the number of states is another");
    inverter_rates(&one->now.model, one->now.v, derivatives);
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2GetEventIndicators)(fmi2Component c, fmi2Real indicators[], size_t n)
{
    (void)indicators;
    return n ? refuse(c, "fmi2GetEventIndicators: there is none") : fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2GetContinuousStates)(fmi2Component c, fmi2Real x[], size_t n)
{
    if (n != INVERTER_STATES)
        return refuse(c, "fmi2GetContinuousStates: the number of states is another");
    memcpy(x, ((instance *)c)->now.model.x, n * sizeof(double));
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2GetNominalsOfContinuousStates)(fmi2Component c, fmi2Real nominal[], size_t n)
{
    size_t k;
    (void)c;
    for (k = 0; k < n; k++)
        nominal[k] = 1.0;
    return fmi2OK;
}
