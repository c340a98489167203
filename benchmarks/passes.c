/* An extended Kalman filter of angle, rate and a coloured disturbance, for LANES sets of parameters side by side.

   The motion of `rovid.model.kernels.filter`: the mean by Runge-Kutta, the covariance by the transition. What depends
   on the damping alone is a polynomial of it, whose coefficients are worked out where the step changes. */
#include <math.h>

#if LANES == 1
typedef double real;
static real size_of(real x) { return fabs(x); }
#else
typedef double real __attribute__((vector_size(8 * LANES), aligned(8)));
typedef long long bits __attribute__((vector_size(8 * LANES), aligned(8)));
static real size_of(real x) { return (real)((bits)x & 0x7fffffffffffffffLL); }
#endif
#define LANE(x, lane) (((double *)&(x))[lane])
#define EACH for (int lane = 0; lane < LANES; lane++)

enum { NODES = 3, ORDER = 4 };
static const double NODE[NODES] = {0.1127016653792583, 0.5, 0.8872983346207417};
static const double WEIGHT[NODES] = {5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0};
static const double STEP_SHARE = 0.3, TINY = 1e-12, SAME = 1e-9;

/* Rows of `sets`. */
typedef struct { real inertia, quadratic, linear, sigma, tau, noise, rate, rate_error; } Set;

/* What is the same in every step of a length: of the noise of the covariance and of the transition. */
typedef struct {
    real fade, mean, early, fresh;
    real angle_by_rate[ORDER], angle_by_push[ORDER], rate_by_push[ORDER];
    real noise00[2 * ORDER - 1], noise01[2 * ORDER - 1], noise11[2 * ORDER - 1], noise02[ORDER], noise12[ORDER];
} Step;

static inline real polynomial(const real *c, int n, real x) {
    real sum = c[n - 1];
    for (int k = n - 2; k >= 0; k--) sum = sum * x + c[k];
    return sum;
}

/* Coefficients in the damping of t^times / inertia times the sum over m of (-t)^m / (m + times)! S_m, S_m the sum of
   all products of m factors out of damping and b: what a torque that fades at b 1/s makes of rate and angle. */
static void series(double t, real b, int times, real inverse, real *c) {
    double factor[ORDER], product = 1.0;
    for (int m = 1; m <= times; m++) product *= t / m;
    for (int m = 0; m < ORDER; m++) { factor[m] = product; product *= -t / (m + 1 + times); }
    for (int j = 0; j < ORDER; j++) {
        real sum = b * 0.0;
        for (int m = ORDER - 1; m >= j; m--) sum = sum * b + factor[m];
        c[j] = sum * inverse;
    }
}

static void add_product(const real *a, const real *b, real weight, real *sum) {
    for (int j = 0; j < ORDER; j++)
        for (int k = 0; k < ORDER; k++) sum[j + k] += weight * a[j] * b[k];
}

static real faded(double t, real tau) {
    real fade;
    EACH LANE(fade, lane) = exp(-t / LANE(tau, lane));
    return fade;
}

static Step step_of(double h, const Set *set) {
    real nothing = set->tau * 0.0, one = nothing + 1.0, rate[ORDER], angle[ORDER];
    real inverse = 1.0 / set->inertia, b = 1.0 / set->tau, grown = 2.0 * set->sigma * set->sigma / set->tau * h;
    Step s;
    s.fade = faded(h, set->tau);
    s.mean = (1.0 - s.fade) * set->tau / h;
    s.early = (1.0 - s.fade) * (h * h / 12.0) * inverse;
    s.fresh = set->sigma * set->sigma * (1.0 - s.fade * s.fade);
    series(h, nothing, 1, one, s.angle_by_rate);
    series(h, b, 1, inverse, s.rate_by_push);
    series(h, b, 2, inverse, s.angle_by_push);
    for (int k = 0; k < 2 * ORDER - 1; k++) s.noise00[k] = s.noise01[k] = s.noise11[k] = nothing;
    for (int k = 0; k < ORDER; k++) s.noise02[k] = s.noise12[k] = nothing;
    for (int node = 0; node < NODES; node++) {
        real weight = grown * WEIGHT[node], left = weight * faded(NODE[node] * h, set->tau);
        series(NODE[node] * h, b, 1, inverse, rate);
        series(NODE[node] * h, b, 2, inverse, angle);
        add_product(angle, angle, weight, s.noise00);
        add_product(angle, rate, weight, s.noise01);
        add_product(rate, rate, weight, s.noise11);
        for (int k = 0; k < ORDER; k++) { s.noise02[k] += left * angle[k]; s.noise12[k] += left * rate[k]; }
    }
    return s;
}

/* How many steps an interval takes: in every lane as many as in the one that needs the most. */
static int steps_in(double interval, real rate, double push, real damping, const Set *set, real inverse) {
    real soon = size_of(rate) + interval * fabs(push) * inverse;
    real stiff = (2.0 * set->quadratic * soon + set->linear) * inverse, b = 1.0 / set->tau;
    int steps = 1;
    EACH {
        double most = interval * (fmax(LANE(damping, lane), LANE(stiff, lane)) + LANE(b, lane)) / STEP_SHARE;
        if (most <= 1.0) continue;
        double quadratic = LANE(set->quadratic, lane), balance = sqrt(fabs(push) / (quadratic + TINY));
        double fastest = fmin(LANE(soon, lane), fmax(fabs(LANE(rate, lane)), balance));
        double drag = (2.0 * quadratic * fastest + LANE(set->linear, lane)) * LANE(inverse, lane);
        double wanted = interval * (fmax(LANE(damping, lane), drag) + LANE(b, lane)) / STEP_SHARE;
        if (wanted > 1.0 && (int)wanted + 1 > steps) steps = (int)wanted + 1;
    }
    return steps;
}

/* `torque` and `moment` as in `rovid.model.drive`; `sets` is a Set; `innovations` and `variances` are (n, LANES). */
void filter(long n, const double *time, const double *torque, const double *moment, const double *angle,
            const double *sets, double *innovations, double *variances) {
    const Set set = *(const Set *)sets;
    real *innovation = (real *)innovations, *variance = (real *)variances;
    real nothing = set.tau * 0.0, inverse = 1.0 / set.inertia, measured = set.noise * set.noise;
    real quadratic = set.quadratic * inverse, linear = set.linear * inverse;
    real a = nothing + angle[0], r = set.rate, d = nothing, damping = linear;
    real p00 = measured, p01 = nothing, p02 = nothing;
    real p11 = set.rate_error * set.rate_error, p12 = nothing, p22 = set.sigma * set.sigma;
    double h = 0.0;
    Step step;
    for (long k = 0; k < n; k++) {
        if (k > 0) {
            double interval = time[k] - time[k - 1], push = torque[k - 1];
            int steps = steps_in(interval, r, push, damping, &set, inverse);
            /* Most logs are sampled evenly, but for the rounding of their time. */
            if (fabs(interval / steps - h) > SAME * h) { h = interval / steps; step = step_of(h, &set); }
            for (int s = 0; s < steps; s++) {
                real pull = (push + d * step.mean) * inverse;
                real k1 = pull - (quadratic * size_of(r) + linear) * r, r2 = r + 0.5 * h * k1;
                real k2 = pull - (quadratic * size_of(r2) + linear) * r2, r3 = r + 0.5 * h * k2;
                real k3 = pull - (quadratic * size_of(r3) + linear) * r3, r4 = r + h * k3;
                real k4 = pull - (quadratic * size_of(r4) + linear) * r4;
                damping = 2.0 * quadratic * size_of(r2) + linear;
                a += h / 6.0 * (r + 2.0 * (r2 + r3) + r4) + step.early * d;
                r += h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4) - damping * step.early * d;
                d *= step.fade;
                real f01 = polynomial(step.angle_by_rate, ORDER, damping), f11 = 1.0 - damping * f01;
                real f02 = polynomial(step.angle_by_push, ORDER, damping);
                real f12 = polynomial(step.rate_by_push, ORDER, damping);
                real q00 = p00 + f01 * p01 + f02 * p02, q01 = p01 + f01 * p11 + f02 * p12;
                real q02 = p02 + f01 * p12 + f02 * p22, q11 = f11 * p11 + f12 * p12, q12 = f11 * p12 + f12 * p22;
                p00 = q00 + f01 * q01 + f02 * q02 + polynomial(step.noise00, 2 * ORDER - 1, damping);
                p01 = f11 * q01 + f12 * q02 + polynomial(step.noise01, 2 * ORDER - 1, damping);
                p11 = f11 * q11 + f12 * q12 + polynomial(step.noise11, 2 * ORDER - 1, damping);
                p02 = step.fade * q02 + polynomial(step.noise02, ORDER, damping);
                p12 = step.fade * q12 + polynomial(step.noise12, ORDER, damping);
                p22 = step.fade * step.fade * p22 + step.fresh;
            }
            a += moment[k - 1] * inverse;
            r -= damping * (moment[k - 1] * inverse);
        }
        real s = p00 + measured, e = angle[k] - a, each = 1.0 / s, g0 = p00 * each, g1 = p01 * each, g2 = p02 * each;
        innovation[k] = e;
        variance[k] = s;
        a += g0 * e;
        r += g1 * e;
        d += g2 * e;
        p11 -= g1 * p01;
        p12 -= g1 * p02;
        p22 -= g2 * p02;
        p02 *= 1.0 - g0;
        p01 *= 1.0 - g0;
        p00 *= 1.0 - g0;
    }
}
