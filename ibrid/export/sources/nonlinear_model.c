/* Absolute quantities: the states, and the constants that hold the operating point (p*, q*, ...), which may be moved. */
typedef struct {
    double x[INVERTER_STATES];
    double r[INVERTER_REFERENCES + 1];
    double step;                                     /* s; 0 until inverter_set_step */
    int parts;                                       /* in which a step is integrated */
} inverter;

void inverter_reset(inverter *model);
int inverter_set_step(inverter *model, double step);
void inverter_output(const inverter *model, const double v[2], double i[2]);
void inverter_step(inverter *model, const double before[2], const double after[2]);
void inverter_rates(const inverter *model, const double v[2], double dx[]);
void inverter_tangent(const inverter *model, const double v[2], const double x_seed[], const double v_seed[2], double dx[],
                      double di[2]);

/* --- functions --- */
/* To rest at the operating point; the step stays. */
void inverter_reset(inverter *model)
{
    memcpy(model->x, INVERTER_X0, sizeof INVERTER_X0);
    memcpy(model->r, INVERTER_R0, sizeof INVERTER_R0);
}

/* Prepare steps of this length in s, integrated in parts that are short against the fastest mode. Returns 0, or -1. */
int inverter_set_step(inverter *model, double step)
{
    if (!(step > 0.0) || !(step <= 1e6 * INVERTER_LONGEST))
        return -1;
    model->step = step;
    model->parts = (int)ceil(step / INVERTER_LONGEST);
    return 0;
}

/* i(x, v), at once. */
void inverter_output(const inverter *model, const double v[2], double i[2])
{
    double dx[INVERTER_STATES];
    inverter_law(model->x, v, model->r, dx, i);
}

/* dx/dt(x, v) */
void inverter_rates(const inverter *model, const double v[2], double dx[])
{
    double i[2];
    inverter_law(model->x, v, model->r, dx, i);
}

/* What small changes of the states and of v do to the rates and to i, about where the model is. */
void inverter_tangent(const inverter *model, const double v[2], const double x_seed[], const double v_seed[2], double dx[],
                      double di[2])
{
    inverter_linear(model->x, v, model->r, x_seed, v_seed, dx, di);
}

/* One step with a voltage in a straight line from `before` to `after`, by the Runge-Kutta method of order 4. */
void inverter_step(inverter *model, const double before[2], const double after[2])
{
    static const double at[4] = {0.0, 0.5, 0.5, 1.0}, weight[4] = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0};
    const double h = model->step / model->parts;
    double x[INVERTER_STATES], next[INVERTER_STATES], dx[INVERTER_STATES], v[2], i[2];
    int part, stage, k;
    for (part = 0; part < model->parts; part++) {
        memcpy(next, model->x, sizeof next);
        for (stage = 0; stage < 4; stage++) {
            const double share = (part + at[stage]) / model->parts;
            for (k = 0; k < 2; k++)
                v[k] = before[k] + share * (after[k] - before[k]);
            for (k = 0; k < INVERTER_STATES; k++)
                x[k] = model->x[k] + (stage ? at[stage] * h * dx[k] : 0.0);
            inverter_law(x, v, model->r, dx, i);
            for (k = 0; k < INVERTER_STATES; k++)
                next[k] += weight[stage] * h * dx[k];
        }
        memcpy(model->x, next, sizeof next);
    }
}
