/* The interface of IEEE/CIGRE for real code in EMT programs (CIGRE Technical Brochure 958, 2025; API of structures) around
 * the nonlinear model in inverter.c; written by ibrid.
 *
 * Inputs v_a, v_b, v_c and outputs i_a, i_b, i_c are instantaneous phase values at the terminals, currents out of the inverter.
 * The D axis of the model lies on phase a at time 0, turned by the parameter theta_0: at rest v_a = V_base v0 cos(omega_0 t +
 * theta_0). Zero sequence is dropped. Between two calls the voltage goes in a straight line in the turning frame. All that an
 * instance remembers is in its double states, so that it can be saved and there may be any number of them.
 * The declarations below are the part of the interface that is needed, so that no header has to be found.
 */
#include <stddef.h>

#include "inverter.c"

typedef char char_T;
typedef unsigned char uint8_T;
typedef int int32_T;
typedef float real32_T;
typedef double real64_T;
enum { real64_type = 9, emt_mode = 1, answer_ok = 0, answer_error = 2 };

typedef struct {
    const char_T *Name, *Description, *Unit;
    int DataType;
    int32_T Width;
} signal_info;

typedef union {
    const char_T *Char_Ptr;
    real64_T Real64_Val;
} default_value;

typedef union {
    real64_T Real64_Val;
} limit_value;

typedef struct {
    const char_T *Name, *GroupName, *Description, *Unit;
    int DataType;
    int32_T FixedValue;
    default_value DefaultValue;
    limit_value MinValue, MaxValue;
} parameter_info;

typedef struct {
    uint8_T DLLInterfaceVersion[4];
    const char_T *ModelName, *ModelVersion, *ModelDescription, *GeneralInformation, *ModelCreated, *ModelCreator,
        *ModelLastModifiedDate, *ModelLastModifiedBy, *ModelModifiedComment, *ModelModifiedHistory;
    real64_T FixedStepBaseSampleTime;
    uint8_T EMT_RMS_Mode;
    int32_T NumInputPorts;
    const signal_info *InputPortsInfo;
    int32_T NumOutputPorts;
    const signal_info *OutputPortsInfo;
    int32_T NumParameters;
    const parameter_info *ParametersInfo;
    int32_T NumIntStates, NumFloatStates, NumDoubleStates;
} model_info;

typedef struct {
    void *ExternalInputs, *ExternalOutputs, *Parameters;
    real64_T Time;
    uint8_T SimTool_EMT_RMS_Mode;
    const char_T *LastErrorMessage, *LastGeneralMessage;
    int32_T *IntStates;
    real32_T *FloatStates;
    real64_T *DoubleStates;
} model_instance;

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORTED __attribute__((visibility("default")))
#else
#define EXPORTED
#endif

/* parameters: bases, angle, then the constants that hold the operating point */
enum { V_BASE, I_BASE, THETA_0, FIRST_REFERENCE, PARAMETERS = FIRST_REFERENCE + INVERTER_REFERENCES };
/* double states: those of the model, then the last voltage and its time */
enum { LAST_V = INVERTER_STATES, LAST_TIME = LAST_V + 2, DOUBLE_STATES };

static const signal_info INPUTS[3] = {
    {"v_a", "terminal voltage of phase a", INVERTER_V_UNIT, real64_type, 1},
    {"v_b", "terminal voltage of phase b", INVERTER_V_UNIT, real64_type, 1},
    {"v_c", "terminal voltage of phase c", INVERTER_V_UNIT, real64_type, 1},
};
static const signal_info OUTPUTS[3] = {
    {"i_a", "current of phase a out of the inverter", INVERTER_I_UNIT, real64_type, 1},
    {"i_b", "current of phase b out of the inverter", INVERTER_I_UNIT, real64_type, 1},
    {"i_c", "current of phase c out of the inverter", INVERTER_I_UNIT, real64_type, 1},
};
static const parameter_info PARAMETER_TABLE[PARAMETERS] = {
#define NUMBER(name, group, words, unit, start, low, high)                                                              \
    {name, group, words, unit, real64_type, 0, {.Real64_Val = start}, {low}, {high}}
    NUMBER("V_base", "bases", "peak phase voltage that is 1 per unit", INVERTER_V_UNIT, INVERTER_V_BASE, 1e-9, 1e9),
    NUMBER("I_base", "bases", "peak phase current that is 1 per unit", INVERTER_I_UNIT, INVERTER_I_BASE, 1e-9, 1e9),
    NUMBER("theta_0", "bases", "angle of the terminal voltage of phase a at time 0", "rad", 0.0, -1e3, 1e3),
    INVERTER_PARAMETERS
};
static const model_info INFO = {
    {1, 1, 0, 0}, INVERTER_TITLE, "1.0", "averaged inverter identified by ibrid", INVERTER_POINT, "", "ibrid", "", "", "", "",
    INVERTER_SAMPLE, emt_mode, 3, INPUTS, 3, OUTPUTS, PARAMETERS, PARAMETER_TABLE, 0, 0, DOUBLE_STATES,
};

static void angle_of(const model_instance *one, double *cosine, double *sine)
{
    const double theta = fmod(inverter_omega_0 * one->Time, 6.283185307179586) + ((double *)one->Parameters)[THETA_0];
    *cosine = cos(theta);
    *sine = sin(theta);
}

/* Amplitude-invariant Park: v_D + j v_Q = 2/3 (v_a + a v_b + a^2 v_c) exp(-j theta) / V_base. */
static void voltage_of(const model_instance *one, double v[2])
{
    const double *abc = one->ExternalInputs, base = ((double *)one->Parameters)[V_BASE];
    const double alpha = (2.0 * abc[0] - abc[1] - abc[2]) / 3.0 / base;
    const double beta = (abc[1] - abc[2]) / 1.7320508075688772 / base;
    double c, s;
    angle_of(one, &c, &s);
    v[0] = c * alpha + s * beta;
    v[1] = c * beta - s * alpha;
}

static int give_current(model_instance *one, const inverter *model, const double v[2])
{
    double *abc = one->ExternalOutputs, base = ((double *)one->Parameters)[I_BASE];
    double c, s, i[2], alpha, beta;
    inverter_output(model, v, i);
    angle_of(one, &c, &s);
    alpha = (c * i[0] - s * i[1]) * base;
    beta = (s * i[0] + c * i[1]) * base;
    abc[0] = alpha;
    abc[1] = -0.5 * alpha + 0.8660254037844386 * beta;
    abc[2] = -0.5 * alpha - 0.8660254037844386 * beta;
    if (fabs(alpha) <= 1e300 && fabs(beta) <= 1e300)
        return answer_ok;
    one->LastErrorMessage = "the current is no finite number: the model has left the range in which it means something";
    return answer_error;
}

EXPORTED const model_info *Model_GetInfo(void)
{
    return &INFO;
}

EXPORTED int32_T Model_PrintInfo(void)
{
    return answer_ok;
}

EXPORTED int32_T Model_FirstCall(model_instance *one)
{
    (void)one;
    return answer_ok;
}

EXPORTED int32_T Model_CheckParameters(model_instance *one)
{
    const double *given = one->Parameters;
    int k;
    for (k = 0; k < PARAMETERS; k++)
        if (!(given[k] >= PARAMETER_TABLE[k].MinValue.Real64_Val && given[k] <= PARAMETER_TABLE[k].MaxValue.Real64_Val)) {
            one->LastErrorMessage = "V_base and I_base must be above 0, and every parameter a finite number";
            return answer_error;
        }
    return answer_ok;
}

/* To rest at the operating point, whatever the voltage is. */
EXPORTED int32_T Model_Initialize(model_instance *one)
{
    static const double v0[2] = INVERTER_V_START;
    inverter model;
    inverter_reset(&model);
    memcpy(one->DoubleStates, model.x, sizeof model.x);
    memcpy(one->DoubleStates + LAST_V, v0, sizeof v0);
    one->DoubleStates[LAST_TIME] = one->Time;
    return give_current(one, &model, v0);
}

/* Goes from the last call to now, then answers; called again at the same time it only answers. */
EXPORTED int32_T Model_Outputs(model_instance *one)
{
    inverter model;
    double v[2], *last = one->DoubleStates + LAST_V;
    const double step = one->Time - one->DoubleStates[LAST_TIME];
    memcpy(model.x, one->DoubleStates, sizeof model.x);
    memcpy(model.r, (double *)one->Parameters + FIRST_REFERENCE, INVERTER_REFERENCES * sizeof(double));
    voltage_of(one, v);
    if (step > 0.0) {
        if (inverter_set_step(&model, step) != 0) {
            one->LastErrorMessage = "the time since the last call is too long to be integrated";
            return answer_error;
        }
        inverter_step(&model, last, v);
        memcpy(one->DoubleStates, model.x, sizeof model.x);
        one->DoubleStates[LAST_TIME] = one->Time;
    }
    memcpy(last, v, sizeof v);
    return give_current(one, &model, v);
}

EXPORTED int32_T Model_Iterate(model_instance *one)
{
    (void)one;
    return answer_ok;
}

EXPORTED int32_T Model_Terminate(model_instance *one)
{
    (void)one;
    return answer_ok;
}
