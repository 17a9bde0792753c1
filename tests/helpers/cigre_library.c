/* A library of the IEEE/CIGRE interface whose answer is a closed form, with signals of many types: i = -g v and a source that
 * follows p_ref and q_ref; as a controller m = 2 (v - r i_f) / v_dc. `deed` says how it fails from t = 0.05 s on. */
#include <math.h>
#include <stdio.h>
#include <string.h>

typedef struct {
    const char *name, *description, *unit;
    int type, width;
} signal_info;
typedef union {
    double number;
    float small;
    const char *text;
    signed char byte;
} value;
typedef struct {
    const char *name, *group, *description, *unit;
    int type, fixed;
    value usual, low, high;
} parameter_info;
typedef struct {
    unsigned char version[4];
    const char *words[10];
    double sample;
    unsigned char mode;
    int inputs;
    const signal_info *input_info;
    int outputs;
    const signal_info *output_info;
    int parameters;
    const parameter_info *parameter_info;
    int ints, floats, doubles;
} model_info;
typedef struct {
    void *inputs, *outputs, *parameters;
    double time;
    unsigned char mode;
    const char *error, *message;
    int *ints;
    float *floats;
    double *doubles;
} instance;

typedef struct {
    signed char enable;
    double v[3];
    float i_f[3];
    unsigned short count;
    float p_ref;
    double q_ref;
} inputs;
typedef struct {
    short status;
    float i[3];
    double m_a, m_b, m_c;
} outputs;
typedef struct {
    signed char deed;
    double g, r, v_dc;
    const char *site;
    float gain;
} parameters;

#ifndef MAJOR
#define MAJOR 1
#endif
#ifndef MODE
#define MODE 1
#endif
static const signal_info INPUTS[] = {
    {"enable", "1: on", "", 2, 1}, {"v", "terminal voltage", "pu", 9, 3}, {"i_f", "current of the bridge", "pu", 8, 3},
    {"count", "of nothing", "", 5, 1}, {"p_ref", "active power", "pu", 8, 1}, {"q_ref", "reactive power", "pu", 9, 1},
};
static const signal_info OUTPUTS[] = {
    {"status", "7: well", "", 4, 1}, {"i", "current", "pu", 8, 3}, {"m_a", "modulation", "N/A", 9, 1},
    {"m_b", "modulation", "N/A", 9, 1}, {"m_c", "modulation", "N/A", 9, 1},
};
static const parameter_info PARAMETERS[] = {
    {"deed", "", "", "", 2, 0, {.byte = 0}, {.byte = 0}, {.byte = 9}},
    {"g", "", "", "pu", 9, 0, {.number = 0.5}, {.number = 0.0}, {.number = 10.0}},
    {"r", "", "", "pu", 9, 0, {.number = 0.0}, {.number = 0.0}, {.number = 10.0}},
    {"v_dc", "", "", "pu", 9, 0, {.number = 2.5}, {.number = 0.0}, {.number = 10.0}},
    {"site", "", "", "", 10, 1, {.text = "nowhere"}, {.number = 0.0}, {.number = 0.0}},
    {"gain", "", "", "", 8, 0, {.small = 1.0f}, {.small = 0.0f}, {.small = 4.0f}},
};
static const model_info INFO = {
    {MAJOR, 1, 0, 0}, {"closed form", "1", "for tests"}, 5e-4, MODE, 6, INPUTS, 5, OUTPUTS, 6, PARAMETERS, 1, 0, 1,
};

const model_info *Model_GetInfo(void) { return &INFO; }
int Model_FirstCall(instance *one) { (void)one; return 0; }
int Model_CheckParameters(instance *one)
{
    const parameters *p = one->parameters;
    if (strcmp(p->site, "nowhere") == 0)
        return 0;
    one->error = "no licence for this site";
    return 2;
}
int Model_Initialize(instance *one) { one->doubles[0] = 1.0; one->ints[0] = 3; return 0; }
int Model_Iterate(instance *one) { (void)one; return 0; }
int Model_Terminate(instance *one) { (void)one; return 0; }
int Model_Outputs(instance *one)
{
    const inputs *in = one->inputs;
    const parameters *p = one->parameters;
    outputs *out = one->outputs;
    double m[3];
    int k;
    volatile int *nowhere = 0;
    if (one->time > 0.05) {
        if (p->deed == 1)
            *nowhere = 1;
        while (p->deed == 2)
            ;
        if (p->deed == 3) {
            one->error = "the fuse\n is gone";
            return 2;
        }
        if (p->deed == 4)
            for (k = 0; k < 100; k++)
                puts("a line of a library that talks");
    }
    for (k = 0; k < 3; k++) {
        const double angle = 314.15926535897932 * one->time - 2.0943951023931953 * k;
        const double source = in->p_ref * cos(angle) + in->q_ref * sin(angle);
        out->i[k] = (float)(p->gain * (in->enable ? source - p->g * in->v[k] : 0.0) * one->doubles[0] * (one->ints[0] == 3));
        m[k] = 2.0 * (in->v[k] - p->r * in->i_f[k]) / p->v_dc;
    }
    if (p->deed == 5 && one->time > 0.05)
        out->i[0] = (float)NAN;
    out->m_a = m[0];
    out->m_b = m[1];
    out->m_c = m[2];
    out->status = 7;
    return 1; /* a message */
}
