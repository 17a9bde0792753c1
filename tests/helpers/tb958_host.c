/* A small EMT program with the interface of CIGRE Technical Brochure 958: it loads a model by name, asks what it is, gives it
 * a balanced voltage that sags at 10 ms, and prints the three currents. Structures as the brochure declares them.
 * usage: host LIBRARY STEPS STEP SAG THETA
 */
#include <dlfcn.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct { const char *Name, *Description, *Unit; int DataType; int32_t Width; } Signal;
typedef union { char Char_Val; const char *Char_Ptr; int32_t Int32_Val; double Real64_Val; } Value;
typedef struct {
    const char *Name, *GroupName, *Description, *Unit;
    int DataType;
    int32_t FixedValue;
    Value DefaultValue, MinValue, MaxValue;
} Parameter;
typedef struct {
    uint8_t DLLInterfaceVersion[4];
    const char *ModelName, *ModelVersion, *ModelDescription, *GeneralInformation, *ModelCreated, *ModelCreator;
    const char *ModelLastModifiedDate, *ModelLastModifiedBy, *ModelModifiedComment, *ModelModifiedHistory;
    double FixedStepBaseSampleTime;
    uint8_t EMT_RMS_Mode;
    int32_t NumInputPorts;
    const Signal *InputPortsInfo;
    int32_t NumOutputPorts;
    const Signal *OutputPortsInfo;
    int32_t NumParameters;
    const Parameter *ParametersInfo;
    int32_t NumIntStates, NumFloatStates, NumDoubleStates;
} Info;
typedef struct {
    void *ExternalInputs, *ExternalOutputs, *Parameters;
    double Time;
    uint8_t SimTool_EMT_RMS_Mode;
    const char *LastErrorMessage, *LastGeneralMessage;
    int32_t *IntStates;
    float *FloatStates;
    double *DoubleStates;
} Instance;
typedef int32_t (*Call)(Instance *);

static Call find(void *library, const char *name)
{
    Call found = (Call)dlsym(library, name);
    if (!found) {
        fprintf(stderr, "lacks %s\n", name);
        exit(3);
    }
    return found;
}

static void require(int32_t answer, const Instance *one)
{
    if (answer == 2) {
        fprintf(stderr, "%s\n", one->LastErrorMessage);
        exit(2);
    }
}

int main(int count, char **word)
{
    void *library = count == 6 ? dlopen(word[1], RTLD_NOW) : NULL;
    const Info *info;
    Instance one;
    double *v, *i, *number, saved[64], V = 0.0, step, sag, theta;
    int k, n, steps;
    if (!library) {
        fprintf(stderr, "%s\n", count == 6 ? dlerror() : "usage");
        return 3;
    }
    steps = atoi(word[2]), step = atof(word[3]), sag = atof(word[4]), theta = atof(word[5]);
    info = ((const Info *(*)(void))dlsym(library, "Model_GetInfo"))();
    printf("%s %d %d %d %g %s %s\n", info->ModelName, info->NumInputPorts, info->NumOutputPorts, info->EMT_RMS_Mode,
           info->FixedStepBaseSampleTime, info->InputPortsInfo[0].Unit, info->OutputPortsInfo[0].Unit);
    memset(&one, 0, sizeof one);
    one.SimTool_EMT_RMS_Mode = 1;
    one.ExternalInputs = v = calloc((size_t)info->NumInputPorts, sizeof(double));
    one.ExternalOutputs = i = calloc((size_t)info->NumOutputPorts, sizeof(double));
    one.Parameters = number = calloc((size_t)info->NumParameters, sizeof(double));
    one.DoubleStates = calloc((size_t)info->NumDoubleStates, sizeof(double));
    for (k = 0; k < info->NumParameters; k++) {
        const Parameter *told = &info->ParametersInfo[k];
        number[k] = strcmp(told->Name, "theta_0") ? told->DefaultValue.Real64_Val : theta;
        if (!strcmp(told->Name, "V_base"))
            V = number[k];
    }
    require(find(library, "Model_FirstCall")(&one), &one);
    ((int32_t (*)(void))dlsym(library, "Model_PrintInfo"))();
    require(find(library, "Model_CheckParameters")(&one), &one);
    require(find(library, "Model_Initialize")(&one), &one);
    for (n = 0; n <= steps; n++) {
        one.Time = n * step;
        for (k = 0; k < 3; k++)
            v[k] = V * (one.Time >= 0.01 - 1e-9 ? sag : 1.0)
                   * cos(376.99111843077515 * one.Time + theta - k * 2.0943951023931953);
        if (n == steps / 2) { /* a program that takes a step back */
            memcpy(saved, one.DoubleStates, (size_t)info->NumDoubleStates * sizeof(double));
            require(find(library, "Model_Outputs")(&one), &one);
            memcpy(one.DoubleStates, saved, (size_t)info->NumDoubleStates * sizeof(double));
        }
        require(find(library, "Model_Outputs")(&one), &one);
        require(find(library, "Model_Iterate")(&one), &one);
        printf("%.17g %.17g %.17g\n", i[0], i[1], i[2]);
    }
    require(find(library, "Model_Terminate")(&one), &one);
    dlclose(library);
    return 0;
}
