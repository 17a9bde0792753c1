/* The deviation of the states, and what one step of the set length does to it. */
typedef struct {
    double x[INVERTER_STATES];
    double step;                                     /* s; 0 until inverter_set_step */
    double free_motion[INVERTER_STATES][INVERTER_STATES];
    double held[INVERTER_STATES][2];                 /* of a voltage that stays */
    double ramp[INVERTER_STATES][2];                 /* of a voltage that rises by one during the step */
} inverter;

void inverter_reset(inverter *model);
int inverter_set_step(inverter *model, double step);
void inverter_output(const inverter *model, const double v[2], double i[2]);
void inverter_step(inverter *model, const double before[2], const double after[2]);
void inverter_rates(const inverter *model, const double v[2], double dx[]);
void inverter_tangent(const inverter *model, const double v[2], const double x_seed[], const double v_seed[2], double dx[],
                      double di[2]);

/* --- functions --- */
enum { INVERTER_AUGMENTED = INVERTER_STATES + 4 };
typedef double inverter_matrix[INVERTER_AUGMENTED][INVERTER_AUGMENTED];

static void inverter_multiply(inverter_matrix a, inverter_matrix b, inverter_matrix product)
{
    int i, j, k;
    for (i = 0; i < INVERTER_AUGMENTED; i++)
        for (j = 0; j < INVERTER_AUGMENTED; j++) {
            double sum = 0.0;
            for (k = 0; k < INVERTER_AUGMENTED; k++)
                sum += a[i][k] * b[k][j];
            product[i][j] = sum;
        }
}

/* exp(m) by scaling, a Taylor series of degree 16 and squaring; |m| / 2^k <= 1/2 leaves 1e-20 outside the series */
static void inverter_exponential(inverter_matrix m, inverter_matrix result)
{
    inverter_matrix other;
    double norm = 0.0;
    int i, j, degree, squarings = 0;
    for (j = 0; j < INVERTER_AUGMENTED; j++) {
        double sum = 0.0;
        for (i = 0; i < INVERTER_AUGMENTED; i++)
            sum += fabs(m[i][j]);
        norm = sum > norm ? sum : norm;
    }
    for (; norm > 0.5 && squarings < 2000; norm /= 2.0)
        squarings++;
    for (i = 0; i < INVERTER_AUGMENTED; i++)
        for (j = 0; j < INVERTER_AUGMENTED; j++) {
            m[i][j] = ldexp(m[i][j], -squarings);
            result[i][j] = i == j ? 1.0 : 0.0;
        }
    for (degree = 16; degree > 0; degree--) {
        inverter_multiply(m, result, other);
        for (i = 0; i < INVERTER_AUGMENTED; i++)
            for (j = 0; j < INVERTER_AUGMENTED; j++)
                result[i][j] = other[i][j] / degree + (i == j ? 1.0 : 0.0);
    }
    for (; squarings > 0; squarings--) {
        inverter_multiply(result, result, other);
        memcpy(result, other, sizeof(inverter_matrix));
    }
}

/* Back to rest; the step stays. */
void inverter_reset(inverter *model)
{
    memset(model->x, 0, sizeof model->x);
}

/* Prepare steps of this length in s. Returns 0, or -1 where it is not above 0 or the motion overflows within it. */
int inverter_set_step(inverter *model, double step)
{
    inverter_matrix rate, after;
    int i, j;
    if (!(step > 0.0) || !(step <= 1e9))
        return -1;
    memset(rate, 0, sizeof rate);
    for (i = 0; i < INVERTER_STATES; i++) {
        for (j = 0; j < INVERTER_STATES; j++)
            rate[i][j] = step * INVERTER_A[i][j] * INVERTER_SCALE[j] / INVERTER_SCALE[i];
        for (j = 0; j < 2; j++)
            rate[i][INVERTER_STATES + j] = step * INVERTER_B[i][j] / INVERTER_SCALE[i];
    }
    for (j = 0; j < 2; j++)
        rate[INVERTER_STATES + j][INVERTER_STATES + 2 + j] = 1.0;
    inverter_exponential(rate, after);
    for (i = 0; i < INVERTER_STATES; i++)
        for (j = 0; j < INVERTER_AUGMENTED; j++)
            if (!(fabs(after[i][j]) <= 1e300))
                return -1;
    for (i = 0; i < INVERTER_STATES; i++) {
        for (j = 0; j < INVERTER_STATES; j++)
            model->free_motion[i][j] = after[i][j] * INVERTER_SCALE[i] / INVERTER_SCALE[j];
        for (j = 0; j < 2; j++) {
            model->held[i][j] = after[i][INVERTER_STATES + j] * INVERTER_SCALE[i];
            model->ramp[i][j] = after[i][INVERTER_STATES + 2 + j] * INVERTER_SCALE[i];
        }
    }
    model->step = step;
    return 0;
}

/* i = C x + D v, at once. */
void inverter_output(const inverter *model, const double v[2], double i[2])
{
    int row, k;
    for (row = 0; row < 2; row++) {
        i[row] = INVERTER_D[row][0] * v[0] + INVERTER_D[row][1] * v[1];
        for (k = 0; k < INVERTER_STATES; k++)
            i[row] += INVERTER_C[row][k] * model->x[k];
    }
}

/* dx/dt = A x + B v */
void inverter_rates(const inverter *model, const double v[2], double dx[])
{
    int i, j;
    for (i = 0; i < INVERTER_STATES; i++) {
        dx[i] = INVERTER_B[i][0] * v[0] + INVERTER_B[i][1] * v[1];
        for (j = 0; j < INVERTER_STATES; j++)
            dx[i] += INVERTER_A[i][j] * model->x[j];
    }
}

/* What changes of the states and of v do to the rates and to i: the same everywhere. */
void inverter_tangent(const inverter *model, const double v[2], const double x_seed[], const double v_seed[2], double dx[],
                      double di[2])
{
    inverter seed;
    (void)model, (void)v;
    memcpy(seed.x, x_seed, sizeof seed.x);
    inverter_rates(&seed, v_seed, dx);
    inverter_output(&seed, v_seed, di);
}

/* One step, exact for a voltage that goes in a straight line from `before` to `after`; for one that is held give it twice. */
void inverter_step(inverter *model, const double before[2], const double after[2])
{
    double next[INVERTER_STATES];
    int i, j;
    for (i = 0; i < INVERTER_STATES; i++) {
        next[i] = 0.0;
        for (j = 0; j < INVERTER_STATES; j++)
            next[i] += model->free_motion[i][j] * model->x[j];
        for (j = 0; j < 2; j++)
            next[i] += model->held[i][j] * before[j] + model->ramp[i][j] * (after[j] - before[j]);
    }
    memcpy(model->x, next, sizeof next);
}
