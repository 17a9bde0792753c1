/* A device of FMI 3.0 for co-simulation, as few functions as a runner needs: i = -g v and a source that follows p_ref. Value
 * references: 0 time, 1 to 3 v, 4 to 6 i, 7 g, 8 p_ref, 9 enable (Boolean), 10 tenths of g (Enumeration). */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdlib.h>

#define EXPORTED __attribute__((visibility("default")))
typedef struct { double numbers[9]; bool enable; } device;

static void answer(device *one)
{
    int k;
    for (k = 0; k < 3; k++) {
        const double angle = 314.15926535897932 * one->numbers[0] - 2.0943951023931953 * k;
        one->numbers[4 + k] = one->enable ? one->numbers[8] * cos(angle) - one->numbers[7] * one->numbers[1 + k] : 0.0;
    }
}
EXPORTED const char *fmi3GetVersion(void) { return "3.0"; }
EXPORTED void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *path, bool visible, bool logging,
    bool event, bool early, const unsigned int required[], size_t n, void *environment, void *log, void *update)
{
    device *one = calloc(1, sizeof *one);
    (void)name, (void)token, (void)path, (void)visible, (void)logging, (void)event, (void)early, (void)required, (void)n;
    (void)environment, (void)log, (void)update;
    one->numbers[7] = 0.5;
    return one;
}
EXPORTED void fmi3FreeInstance(void *one) { free(one); }
EXPORTED int fmi3EnterInitializationMode(void *one, bool known, double tolerance, double start, bool stops, double stop)
{
    (void)known, (void)tolerance, (void)stops, (void)stop;
    ((device *)one)->numbers[0] = start;
    return 0;
}
EXPORTED int fmi3ExitInitializationMode(void *one) { answer(one); return 0; }
EXPORTED int fmi3Terminate(void *one) { (void)one; return 0; }
EXPORTED int fmi3SetFloat64(void *one, const unsigned int places[], size_t n, const double values[], size_t m)
{
    size_t k;
    (void)m;
    for (k = 0; k < n; k++)
        ((device *)one)->numbers[places[k]] = values[k];
    return 0;
}
EXPORTED int fmi3GetFloat64(void *one, const unsigned int places[], size_t n, double values[], size_t m)
{
    size_t k;
    (void)m;
    answer(one);
    for (k = 0; k < n; k++)
        values[k] = ((device *)one)->numbers[places[k]];
    return 0;
}
EXPORTED int fmi3SetBoolean(void *one, const unsigned int places[], size_t n, const bool values[], size_t m)
{
    (void)places, (void)n, (void)m;
    ((device *)one)->enable = values[0];
    return 0;
}
EXPORTED int fmi3SetInt64(void *one, const unsigned int places[], size_t n, const long long values[], size_t m)
{
    (void)places, (void)n, (void)m;
    ((device *)one)->numbers[7] = values[0] / 10.0;
    return 0;
}
EXPORTED int fmi3DoStep(void *one, double now, double step, bool never, bool *event, bool *terminate, bool *early, double *last)
{
    (void)never;
    ((device *)one)->numbers[0] = now + step;
    *event = *terminate = *early = false;
    *last = now + step;
    return ((device *)one)->numbers[7] > 5.0 ? 3 : 0;
}
/* What a runner looks for and never calls. */
#define STUB(name) EXPORTED int name(void) { return 3; }
STUB(fmi3ActivateModelPartition) STUB(fmi3CompletedIntegratorStep) STUB(fmi3DeserializeFMUState)
STUB(fmi3EnterConfigurationMode) STUB(fmi3EnterContinuousTimeMode) STUB(fmi3EnterEventMode) STUB(fmi3EnterStepMode)
STUB(fmi3EvaluateDiscreteStates) STUB(fmi3ExitConfigurationMode) STUB(fmi3FreeFMUState)
STUB(fmi3GetAdjointDerivative) STUB(fmi3GetBinary) STUB(fmi3GetBoolean) STUB(fmi3GetClock)
STUB(fmi3GetContinuousStateDerivatives) STUB(fmi3GetContinuousStates) STUB(fmi3GetDirectionalDerivative)
STUB(fmi3GetEventIndicators) STUB(fmi3GetFMUState) STUB(fmi3GetFloat32) STUB(fmi3GetInt16) STUB(fmi3GetInt32)
STUB(fmi3GetInt64) STUB(fmi3GetInt8) STUB(fmi3GetIntervalDecimal) STUB(fmi3GetIntervalFraction)
STUB(fmi3GetNominalsOfContinuousStates) STUB(fmi3GetNumberOfContinuousStates) STUB(fmi3GetNumberOfEventIndicators)
STUB(fmi3GetNumberOfVariableDependencies) STUB(fmi3GetOutputDerivatives) STUB(fmi3GetShiftDecimal)
STUB(fmi3GetShiftFraction) STUB(fmi3GetString) STUB(fmi3GetUInt16) STUB(fmi3GetUInt32) STUB(fmi3GetUInt64)
STUB(fmi3GetUInt8) STUB(fmi3GetVariableDependencies) STUB(fmi3InstantiateModelExchange)
STUB(fmi3InstantiateScheduledExecution) STUB(fmi3Reset) STUB(fmi3SerializeFMUState) STUB(fmi3SerializedFMUStateSize)
STUB(fmi3SetBinary) STUB(fmi3SetClock) STUB(fmi3SetContinuousStates) STUB(fmi3SetDebugLogging) STUB(fmi3SetFMUState)
STUB(fmi3SetFloat32) STUB(fmi3SetInt16) STUB(fmi3SetInt32) STUB(fmi3SetInt8)
STUB(fmi3SetIntervalDecimal) STUB(fmi3SetIntervalFraction) STUB(fmi3SetShiftDecimal) STUB(fmi3SetShiftFraction)
STUB(fmi3SetString) STUB(fmi3SetTime) STUB(fmi3SetUInt16) STUB(fmi3SetUInt32) STUB(fmi3SetUInt64) STUB(fmi3SetUInt8)
STUB(fmi3UpdateDiscreteStates)
