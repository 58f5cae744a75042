/* Inverse kinematics of an elastic arm: the inner loops of lrm_math.ik.
 *
 * C99 and libm only, no state, no allocation: every function works on its arguments, so that threads do not meet.
 * Python packs a model into one `Arm` (kernel_model.py, shared_library.py) and calls the functions marked API with ctypes.
 * Lengths in m, angles in rad, loads in N m; frames are four columns x, y, z, origin: twelve numbers.
 *
 *   1 Arm, state                    5 Error of a goal, Newton's method     8 Poses: all branches
 *   2 Forward kinematics, loads     6 Closed form                          9 Goals that leave motion free
 *   3 Derivatives                   7 Seeds: singular directions,         10 Nearest reachable goal
 *   4 Joint laws, equilibrium         library of poses                    11 Batches
 */
#include <math.h>
#include <stddef.h>
#include <string.h>

#ifdef _WIN32
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif
#ifndef SOURCE_CRC
#define SOURCE_CRC 0
#endif
#define COPY(to, from, count) memcpy(to, from, (size_t)(count) * sizeof *(to))

/* ---------------------------------------------------------------- 1 Arm, state ---------------------------------- */

enum { MAX_SLOTS = 48, MAX_JOINTS = 16, MAX_BODIES = 20, MAX_LAWS = 96, MAX_SPRINGS = 256, MAX_FOUND = 48,
       MAX_POSES = 2048, MAX_TERMS = 128, WAVES = 20 /* residual_field.WAVES_ALONE */ };
enum { MEETING, PARALLEL, SKEW };                                            /* the first two axes, see pieper.py */
enum { SERVO_GAIN, ECCENTRICITY, BACKLASH, NONLINEAR_STIFFNESS, HYSTERESIS, CABLE_SPRING, COUPLING,
       GEAR_RIPPLE };  /* laws.py */
#define FADE 0.05 /* measured_range.FADE */
#define MARGIN 1.25 /* residual_field.MARGIN */
enum { RANKED = 512, MOST_STARTS = 64 };

typedef struct { /* Pieper's normal form of an arm of six joints; pieper.py says what each number is */
    double frame[9], foot[3], centre[3], tip_x[3], tip_z[3], a, links[5][2], offsets[4], v0[3], vc[3], vs[3];
    double elbow[3], length;
    int shape, backwards;
} Form;

typedef struct { /* a model with one payload; moving_slots.py says what slots, fixed transforms and bodies are */
    int slots, joints, others, bodies, laws, poses, has_form, laws_known;
    double gravity[3], reach, nonlinear_bound;
    double fixed[MAX_SLOTS + 1][12], moment[MAX_BODIES][4]; /* frames; mass moments and mass in the slot's frame */
    int fixed_turn[MAX_SLOTS + 1], axis[MAX_SLOTS]; /* whether the fixed turns; 0..2 turns about x, y, z, 3..5 slides */
    int mimics, mimic[MAX_JOINTS], leader[MAX_JOINTS]; /* slots that turn with others beside their own amounts */
    double ratio[MAX_JOINTS];
    int joint[MAX_JOINTS], other[MAX_SLOTS], inboard[MAX_BODIES], counted[MAX_SLOTS], moved[MAX_SLOTS];
    double zero[MAX_SLOTS], start[MAX_SLOTS], lower[MAX_JOINTS], upper[MAX_JOINTS]; /* unloaded; mean; limits */
    int spring_from[MAX_SLOTS + 1], spring_load[MAX_SPRINGS]; /* compliances, sparse by rows: slot, load's slot */
    double spring[MAX_SPRINGS], play[MAX_SLOTS], play_force[MAX_SLOTS]; /* axial play: m from end to end, N */
    int law[MAX_LAWS], law_joint[MAX_LAWS];
    double law_p[MAX_LAWS][4];
    int terms, term_axis[MAX_TERMS], term_factor[MAX_TERMS][3]; /* residual field: residual_field.py */
    int field_axis[MAX_SLOTS];                                  /* along which it moves a slot, from 1; 0: none */
    double term[MAX_TERMS], field_lower[MAX_JOINTS], field_upper[MAX_JOINTS], field_base[9], field_turn;
    int field_waves; /* most half waves of any angle */
    Form form; /* of the arm itself if nothing deflects, else of one that looks like it: seeds */
    const double *library_q, *library_slots; /* commands (M,n) and slot amounts (M,slots) of poses at rest */
    const float *library_columns;            /* (12,M): their tool frames, for one pass */
} Arm;

typedef struct {
    double q[MAX_JOINTS], slots[MAX_SLOTS], tau[MAX_SLOTS], excess, slope;
    int side[MAX_JOINTS], detour[MAX_JOINTS], free;
} Solution; /* command, state, rad beyond the limits, m/rad of the slowest motion and its joint from 1 (0: none) */

typedef struct {
    int count, steps;
    Solution at[MAX_FOUND];
} Found;

static const int UNKNOWN[MAX_JOINTS] = {0}; /* sides of arrival */
static const double NOTHING[MAX_SLOTS] = {0};
typedef double Row[MAX_JOINTS + 1]; /* of a matrix: derivatives by the joints, and at last the value or what it lacks */
typedef struct { /* what belongs to one set of slot amounts */
    double tcp[12], axis[MAX_SLOTS][3], origin[MAX_SLOTS][3], tau[MAX_SLOTS];
    double lever[MAX_SLOTS][3], by_counted[MAX_SLOTS][3], by_moved[MAX_SLOTS][3];
    double outboard[MAX_BODIES + 1][4]; /* first moment and mass of body b and all outboard */
    double J[6][MAX_SLOTS], e[6], lack[MAX_SLOTS];
    Row total[6], follow[MAX_SLOTS];
    int follower[MAX_SLOTS], followers;
    Row field[4]; /* displacement by a residual field along x, y, z, from 1; 0: along none */
} State;

static const double LEVER = 0.1;     /* m: weight of a turn by 1 rad against a distance (characteristic length) */
static const double CLOSE = 5e-11;   /* m: a goal is reached */
static const double SLACK = 0.4;     /* rad: joints sag and play by less, so seeds further outside lead nowhere */
static const double AT_LIMIT = 1e-9; /* rad: a command this far beyond a limit is at the limit */
static const double SAME = 1e-6;     /* rad: commands no further apart are one solution */
static const double ONE_FAMILY = 0.02; /* rad: the same where the goal leaves motion free */
static const double LONGEST = 0.6;   /* rad: most that a joint turns in one step of Newton's method */
static const double TURN = 6.283185307179586;

static double larger(double a, double b) { return a > b ? a : b; } /* inline, as fmax is not */
static double lesser(double a, double b) { return a < b ? a : b; }
static double clipped(double x, double lower, double upper) { return lesser(larger(x, lower), upper); }
static int sign(double x) { return (x > 0) - (x < 0); }
static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
static void cross(const double *a, const double *b, double *out) {
    out[0] = a[1] * b[2] - a[2] * b[1], out[1] = a[2] * b[0] - a[0] * b[2], out[2] = a[0] * b[1] - a[1] * b[0];
}
static double square_distance(const double *a, const double *b, int n) {
    double square = 0;
    for (int i = 0; i < n; i++) square += (a[i] - b[i]) * (a[i] - b[i]);
    return square;
}
static double length(const double *x, int n) { return sqrt(square_distance(x, NOTHING, n)); }
static double distance(const double *a, const double *b) { return sqrt(square_distance(a, b, 3)); }
static double apart(const double *a, const double *b, int n) {
    double out = 0;
    for (int i = 0; i < n; i++) out = larger(out, fabs(a[i] - b[i]));
    return out;
}
static double largest(const double *x, int n) { return apart(x, NOTHING, n); }
/* x plus the scalar product of a and b. */
static double plus_product(double x, const double *a, const double *b, int n) {
    for (int i = 0; i < n; i++) x += a[i] * b[i];
    return x;
}
static void add(double by, const double *x, int n, double *out) {
    for (int i = 0; i < n; i++) out[i] += by * x[i];
}
static void scale(double by, double *x, int n) {
    for (int i = 0; i < n; i++) x[i] *= by;
}
static double excess_of(const Arm *a, const double *q) {
    double out = -INFINITY;
    for (int j = 0; j < a->joints; j++) out = larger(out, larger(a->lower[j] - q[j], q[j] - a->upper[j]));
    return out;
}

/* ---------------------------------------------------------------- 2 Forward kinematics, loads ------------------- */

/* A vector in the base's axes, from one (3,) in those of a frame. */
static void in_base(const double *frame, const double *v, double *out) {
    for (int i = 0; i < 3; i++) out[i] = frame[i] * v[0] + frame[3 + i] * v[1] + frame[6 + i] * v[2];
}

/* Product of exponentials outwards (Brockett 1984), then gravity's load on each slot by its screw and the first mass
 * moment that it counts (thesis Eqs 2.44 to 2.48): tau = (g x axis) . sum m (c - origin); m g . axis if it slides.
 * after: NULL, or the frames before the first slot and after each one, (slots + 1, 12). */
static void place(const Arm *a, const double *s, State *w, double *after) {
    double f[12] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, *p = f + 9, before[12], driven[MAX_SLOTS];
    if (a->mimics) {
        COPY(driven, s, a->slots);
        for (int k = 0; k < a->mimics; k++) driven[a->mimic[k]] += a->ratio[k] * s[a->leader[k]];
        s = driven;
    }
    for (int v = 0, body = 0; v <= a->slots; v++) {
        if (after) COPY(after + 12 * v, f, 12);
        for (; body < a->bodies && a->inboard[body] == v; body++) {
            double *out = w->outboard[body];
            in_base(f, a->moment[body], out), out[3] = a->moment[body][3], add(out[3], p, 3, out);
        }
        COPY(before, f, 12);
        in_base(before, a->fixed[v] + 9, p), add(1, before + 9, 3, p);
        for (int k = 0; k < 9 && a->fixed_turn[v]; k += 3) in_base(before, a->fixed[v] + k, f + k);
        if (v == a->slots) break;
        const int kind = a->axis[v];
        double *x = f + 3 * (kind % 3), *y = f + 3 * ((kind + 1) % 3), *z = f + 3 * ((kind + 2) % 3);
        if (kind >= 3) add(s[v], x, 3, p);
        COPY(w->axis[v], x, 3), COPY(w->origin[v], p, 3);
        if (kind >= 3) continue;
        const double c = cos(s[v]), sine = sin(s[v]);
        for (int i = 0; i < 3; i++) {
            const double old = y[i];
            y[i] = c * old + sine * z[i], z[i] = c * z[i] - sine * old;
        }
    }
    COPY(w->tcp, f, 12);
}
static void forward(const Arm *a, const double *s, State *w) {
    place(a, s, w, NULL);
    memset(w->outboard[a->bodies], 0, sizeof *w->outboard);
    for (int b = a->bodies - 1; b >= 0; b--) add(1, w->outboard[b + 1], 4, w->outboard[b]);
    for (int v = 0; v < a->slots; v++) {
        const double *first = w->outboard[a->counted[v]];
        double *lever = w->lever[v];
        cross(a->gravity, w->axis[v], lever);
        w->tau[v] = dot(lever, first) - first[3] * dot(lever, w->origin[v]);
        if (a->axis[v] >= 3) lever[0] = lever[1] = lever[2] = 0, w->tau[v] = first[3] * dot(a->gravity, w->axis[v]);
    }
    for (int k = 0; k < a->mimics; k++) w->tau[a->leader[k]] += a->ratio[k] * w->tau[a->mimic[k]]; /* virtual work */
}

/* ---------------------------------------------------------------- 3 Derivatives --------------------------------- */

/* How a first moment and mass (4,), or a point and 1, changes with slot v. */
static void swept(const Arm *a, const State *w, int v, const double *moment, double *out) {
    double arm[3];
    for (int i = 0; i < 3; i++) arm[i] = moment[i] - moment[3] * w->origin[v][i];
    if (a->axis[v] < 3) cross(w->axis[v], arm, out);
    else for (int i = 0; i < 3; i++) out[i] = moment[3] * w->axis[v][i];
}

/* Geometric Jacobian: velocity of the tool (m/rad, or 1) above LEVER times its angular velocity; w->total: the joints'
 * columns of it. */
static void jacobian(const Arm *a, State *w) {
    const double tip[4] = {w->tcp[9], w->tcp[10], w->tcp[11], 1};
    for (int v = 0; v < a->slots; v++) {
        double along[3];
        swept(a, w, v, tip, along);
        for (int i = 0; i < 3; i++) w->J[i][v] = along[i], w->J[3 + i][v] = a->axis[v] < 3 ? LEVER * w->axis[v][i] : 0;
    }
    for (int k = 0; k < a->mimics; k++)
        for (int r = 0; r < 6; r++) w->J[r][a->leader[k]] += a->ratio[k] * w->J[r][a->mimic[k]];
    for (int r = 0; r < 6; r++)
        for (int j = 0; j < a->joints; j++) w->total[r][j] = w->J[r][a->joint[j]];
}

static void sweep(const Arm *a, State *w) {
    for (int v = 0; v < a->slots; v++) {
        swept(a, w, v, w->outboard[a->moved[v]], w->by_moved[v]);
        swept(a, w, v, w->outboard[a->counted[v]], w->by_counted[v]);
    }
}

/* d tau_u / d s_v, (slots,) added `by` times to out: the Hessian of gravity's potential; less what u counts although v,
 * inboard of it, does not move it. Of slots that each move alone. */
static void add_each_load_derivative(const Arm *a, const State *w, int u, double by, double *out) {
    for (int v = u; v < a->slots; v++) out[v] += by * dot(w->lever[u], w->by_moved[v]);
    for (int v = 0; v < u; v++) {
        double all[3];
        out[v] += by * dot(w->lever[v], w->by_counted[u]);
        if (a->counted[u] >= a->moved[v]) continue;
        swept(a, w, v, w->outboard[a->counted[u]], all);
        out[v] -= by * (dot(w->lever[u], all) - dot(w->lever[u], w->by_moved[v]));
    }
}
/* The same of slots that carry along those that follow them. */
static void add_load_derivatives(const Arm *a, const State *w, int u, double by, double *out) {
    if (!a->mimics) { add_each_load_derivative(a, w, u, by, out); return; }
    double all[MAX_SLOTS] = {0};
    add_each_load_derivative(a, w, u, by, all);
    for (int k = 0; k < a->mimics; k++)
        if (a->leader[k] == u) add_each_load_derivative(a, w, a->mimic[k], by * a->ratio[k], all);
    for (int k = 0; k < a->mimics; k++) all[a->leader[k]] += a->ratio[k] * all[a->mimic[k]];
    add(1, all, a->slots, out);
}

/* Response of the deflection of slot `row` to every slot's motion, (slots,). */
static void deflection_derivative(const Arm *a, const State *w, int row, double *out) {
    for (int v = 0; v < a->slots; v++) out[v] = 0;
    for (int k = a->spring_from[row]; k < a->spring_from[row + 1]; k++)
        add_load_derivatives(a, w, a->spring_load[k], a->spring[k], out);
    if (a->play[row] == 0) return;
    const double taken = tanh(w->tau[row] / a->play_force[row]);
    add_load_derivatives(a, w, row, 0.5 * a->play[row] / a->play_force[row] * (1 - taken * taken), out);
}

/* Of a matrix A (rows, n): A x (rows,), and A^T x (n,). */
static void times(const Row *A, int rows, int n, const double *x, double *out) {
    for (int r = 0; r < rows; r++) out[r] = plus_product(0, A[r], x, n);
}
static void transposed_times(const Row *A, int rows, int n, const double *x, double *out) {
    for (int j = 0; j < n; j++) out[j] = 0;
    for (int r = 0; r < rows; r++) add(x[r], A[r], n, out);
}

/* Cholesky factors of A^T A (n, n) if `columns`, or of A A^T (rows, rows), plus `damping` on the diagonal: the lower
 * triangle, reciprocal pivots; a pivot that is not positive becomes 0. */
static void factorise(const Row *A, int rows, int n, int columns, double damping, Row *N) {
    for (int i = 0; i < (columns ? n : rows); i++)
        for (int j = 0; j <= i; j++) {
            double x = i == j ? damping : 0;
            if (columns) for (int k = 0; k < rows; k++) x += A[k][i] * A[k][j];
            else x = plus_product(x, A[i], A[j], n);
            for (int k = 0; k < j; k++) x -= N[i][k] * N[j][k];
            N[i][j] = i == j ? (x > 0 ? 1 / sqrt(x) : 0) : x * N[j][j];
        }
}
static void substitute(const Row *N, double *y, int m) {
    for (int i = 0; i < m; i++) {
        for (int k = 0; k < i; k++) y[i] -= N[i][k] * y[k];
        y[i] *= N[i][i];
    }
    for (int i = m - 1; i >= 0; i--) {
        for (int k = i + 1; k < m; k++) y[i] -= N[k][i] * y[k];
        y[i] *= N[i][i];
    }
}
/* The least x (n,) with A x = y (rows,), by the factors N of A A^T. */
static void least_norm(const Row *A, const Row *N, int rows, int n, const double *y, double *x) {
    double weight[6];
    COPY(weight, y, rows), substitute(N, weight, rows), transposed_times(A, rows, n, weight, x);
}

/* ---------------------------------------------------------------- 4 Joint laws, equilibrium --------------------- */

/* Amount of a slot under the loads tau, by springs and axial play alone; joints at command zero. */
static double spring_amount(const Arm *a, const double *tau, int v) {
    double x = a->zero[v];
    for (int k = a->spring_from[v]; k < a->spring_from[v + 1]; k++) x += a->spring[k] * tau[a->spring_load[k]];
    if (a->play[v] != 0) x += 0.5 * a->play[v] * tanh(tau[v] / a->play_force[v]);
    return x;
}
static void linear_command(const Arm *a, const double *tau, const double *s, double *q) {
    for (int j = 0; j < a->joints; j++) q[j] = s[a->joint[j]] - spring_amount(a, tau, a->joint[j]);
}

/* compliance.py: deflection of a nonlinear spring, under a torque held at the end of its range where it is far outside
 * (measured_range.held). */
static double nonlinear_deflection(const double *p, double torque) {
    const double over = torque - clipped(torque, p[2], p[3]), part = over / (FADE * (p[3] - p[2]) + 1e-9);
    const double t = torque - over * (1 - exp(-part * part));
    return t * (p[0] * fabs(t) + p[1] * t * t);
}

/* True angles of the joints less their commands: springs, and the laws of laws.py, for commands q under gravity loads;
 * side: -1, 0, 1 of each joint's arrival. */
static void joint_errors(const Arm *a, const double *gravity_load, const double *q, const int *side, double *out) {
    double tau[MAX_SLOTS];
    COPY(tau, gravity_load, a->slots);
    for (int k = 0; k < a->laws; k++)
        if (a->law[k] == CABLE_SPRING) tau[a->joint[a->law_joint[k]]] -= a->law_p[k][0] * q[a->law_joint[k]];
    for (int j = 0; j < a->joints; j++) out[j] = spring_amount(a, tau, a->joint[j]);
    for (int k = 0; k < a->laws; k++) {
        const int j = a->law_joint[k];
        const double *p = a->law_p[k], x = q[j], load = tau[a->joint[j]];
        switch (a->law[k]) {
        case SERVO_GAIN: out[j] += (x > 0 ? p[0] : p[1]) * x; break;
        case ECCENTRICITY:
            out[j] += p[0] * sin(x) + p[1] * (cos(x) - 1) + 2 * sin(x) * (p[2] * cos(x) - p[3] * sin(x)); break;
        case BACKLASH:
            out[j] += 0.5 * p[0] * ((1 - p[2]) * tanh(load / p[1]) + p[2] * load / hypot(load, p[1])); break;
        case NONLINEAR_STIFFNESS: out[j] += nonlinear_deflection(p, load); break;
        case HYSTERESIS: out[j] += 0.5 * p[0] * side[j]; break;
        case COUPLING: out[j] += p[0] * q[(int)p[1]]; break;
        case GEAR_RIPPLE: out[j] += p[0] * sin(p[2] * x) + p[1] * (cos(p[2] * x) - 1); break;
        default: break;
        }
    }
}

/* residual_field.py: the displacement of all base slots for commands q, after its derivatives. */
static void displacement(const Arm *a, const double *q, Row *out) {
    double t[WAVES * MAX_JOINTS + 1] = {1}, by_q[WAVES * MAX_JOINTS + 1] = {0}, fade[MAX_JOINTS + 1] = {0}, inside = 1;
    const int n = a->joints;
    memset(out, 0, 4 * sizeof *out);
    if (!a->terms) return;
    for (int j = 0; j < n; j++) {
        const double l = a->field_lower[j], u = a->field_upper[j], half = u > l ? 0.5 * MARGIN * (u - l) : 1;
        const double wave = 0.25 * TURN / half, x = wave * (q[j] - 0.5 * (l + u) + half), c = cos(x), s = sin(x);
        const double root = sqrt(2.0), width = FADE * (u - l) + 1e-9, part = (q[j] - clipped(q[j], l, u)) / width;
        double cm = c, sm = s; /* of m x */
        for (int m = 1; m <= a->field_waves; m++) {
            t[WAVES * j + m] = root * cm, by_q[WAVES * j + m] = -root * m * sm * wave;
            const double next = c * cm - s * sm;
            sm = s * cm + c * sm, cm = next;
        }
        inside *= exp(-part * part), fade[j] = -2 * part / width;
    }
    for (int k = 0; k < a->terms; k++) {
        const int *f = a->term_factor[k];
        double *along = out[a->term_axis[k]];
        along[n] += a->term[k] * t[f[0]] * t[f[1]] * t[f[2]];
        for (int r = 0; r < 3; r++)
            if (f[r]) along[(f[r] - 1) / WAVES] += a->term[k] * by_q[f[r]] * t[f[(r + 1) % 3]] * t[f[(r + 2) % 3]];
    }
    /* along axes that turn with joint 1, where the field fades; then along the world's */
    const double c = cos(q[0] + a->field_turn), s = sin(q[0] + a->field_turn), v[3] = {out[1][n], out[2][n], out[3][n]};
    for (int j = 0; j <= n; j++) {
        double u[3], world[3];
        for (int i = 0; i < 3; i++) u[i] = inside * (out[i + 1][j] + v[i] * fade[j]);
        if (j == 0) u[0] -= inside * v[1], u[1] += inside * v[0];
        const double turned[3] = {c * u[0] - s * u[1], s * u[0] + c * u[1], u[2]};
        in_base(a->field_base, turned, world);
        for (int i = 0; i < 3; i++) out[i + 1][j] = world[i];
    }
}

/* One step of Anderson's (1965) method with a memory of one: x moves by the step, or by a secant along the last two. */
typedef struct { double x[MAX_SLOTS], step[MAX_SLOTS]; int known; } Memory;
static void accelerate(Memory *m, double *x, const double *step, int n) {
    double size = 1e-300, along = 0;
    for (int i = 0; m->known && i < n; i++) {
        const double change = step[i] - m->step[i];
        size += change * change, along += step[i] * change;
    }
    for (int i = 0; i < n; i++) {
        const double now = x[i], back = m->known ? along / size * (now - m->x[i] + step[i] - m->step[i]) : 0;
        x[i] += step[i] - back, m->x[i] = now, m->step[i] = step[i];
    }
    m->known = 1;
}

/* Commands that hold the slots at s: 1, or 0 where the laws do not settle. */
static int command(const Arm *a, const double *tau, const double *s, const int *side, double *q) {
    Memory memory = {.known = 0};
    linear_command(a, tau, s, q);
    if (!a->laws) return 1;
    for (int it = 0; it < 100; it++) {
        double error[MAX_JOINTS], step[MAX_JOINTS];
        joint_errors(a, tau, q, side, error);
        for (int j = 0; j < a->joints; j++) step[j] = s[a->joint[j]] - error[j] - q[j];
        if (!(largest(step, a->joints) < 10)) return 0;
        const int done = largest(step, a->joints) < 1e-11;
        if (it > 30) add(0.5, step, a->joints, q);
        else accelerate(&memory, q, step, a->joints);
        if (done) return 1;
    }
    return 0;
}

/* How far a slot that is no joint is from where its loads and the residual field would have it. */
static double lack_of(const Arm *a, int v, const double *s, const State *w) {
    return spring_amount(a, w->tau, v) + w->field[a->field_axis[v]][a->joints] - s[v];
}

/* Elastic equilibrium of a command by fixed-point iteration (thesis Figure 4.4), from slot amounts s, in place; the
 * state is that of the amounts before the last step. Iterations, or -1. */
static int settle(const Arm *a, const double *q, const int *side, double tolerance, double *s, State *w) {
    Memory memory = {.known = 0};
    displacement(a, q, w->field);
    for (int it = 1; it <= 300; it++) {
        double error[MAX_JOINTS], step[MAX_SLOTS], change = 0;
        forward(a, s, w);
        joint_errors(a, w->tau, q, side, error);
        for (int j = 0; j < a->joints; j++) step[a->joint[j]] = q[j] + error[j] - s[a->joint[j]];
        for (int i = 0; i < a->others; i++) step[a->other[i]] = lack_of(a, a->other[i], s, w);
        for (int v = 0; v < a->slots; v++) change += fabs(step[v]) * (a->axis[v] < 3 ? a->reach : 1);
        if (!(change < 1e6)) return -1;
        const int done = change <= tolerance;
        if (it <= 20 && !done) accelerate(&memory, s, step, a->slots);
        else add(it > 60 && !done ? 0.4 : 1, step, a->slots, s);
        if (done) return it;
    }
    return -1;
}
/* Whether a slot deflects by more than the effects' formulas hold for (0.5 rad, equilibrium.py). */
static int too_soft(const Arm *a, const double *q, const int *side, const double *s) {
    double stiff[MAX_SLOTS], error[MAX_JOINTS];
    COPY(stiff, a->zero, a->slots);
    joint_errors(a, NOTHING, q, side, error);
    for (int j = 0; j < a->joints; j++) stiff[a->joint[j]] = q[j] + error[j];
    for (int v = 0; v < a->slots; v++) if (a->axis[v] < 3 && fabs(s[v] - stiff[v]) > 0.5) return 1;
    return 0;
}

/* ---------------------------------------------------------------- 5 Error of a goal, Newton's method ------------ */

/* Displacement to the goal (m) and LEVER times the rotation vector to it in w->e; returns the square of both (m^2).
 * rows: 6 a pose, 5 a position and the direction of z (the turn about the tool's x and y), 3 a position. */
static double goal_error(const double *g, int rows, State *w) {
    const double *t = w->tcp, share = rows == 6 ? 0.5 : 1;
    double *e = w->e, turn[3] = {0, 0, 0}, part[3], cosine = rows == 6 ? -0.5 : 0;
    for (int i = 0; i < 3; i++) e[i] = g[9 + i] - t[9 + i], e[3 + i] = 0;
    if (rows == 3) return dot(e, e);
    for (int k = rows == 6 ? 0 : 6; k < 9; k += 3) {
        cross(t + k, g + k, part), add(share, part, 3, turn);
        cosine += share * dot(t + k, g + k);
    }
    const double sine = length(turn, 3), angle = LEVER * atan2(sine, cosine), by = angle / larger(sine, 1e-300);
    for (int i = 0; i < 3; i++) e[3 + i] = by * (rows == 6 ? turn[i] : i < 2 ? dot(turn, t + 3 * i) : 0);
    return dot(e, e) + angle * angle;
}

/* How far the slots that are no joints are from where loads and joints would have them, w->lack; in m at the tool.
 * side: of each joint's arrival, on which the command depends and so the residual field. */
static double lacking(const Arm *a, const double *s, const int *side, State *w) {
    double out = 0, q[MAX_JOINTS];
    if (a->terms && !command(a, w->tau, s, side, q)) linear_command(a, w->tau, s, q);
    displacement(a, q, w->field);
    for (int i = 0; i < a->others; i++) {
        w->lack[i] = lack_of(a, a->other[i], s, w);
        out += fabs(w->lack[i]) * (a->axis[a->other[i]] < 3 ? a->reach : 1);
    }
    return out;
}

/* w->total: Jacobian (rows, joints) of a move of the joints, the followers after it by their loads (w->follow; last
 * column: what they lack). (1 - M)^-1 of their mutual response M is cut after M, what a deflection itself deflects.
 * law_slope: NULL for true joint angles, which the other slots follow; for commands, which the joints follow too by
 * springs and laws, the slopes of their laws (slots,). */
static void total_jacobian(const Arm *a, int rows, const double *law_slope, State *w) {
    const int n = a->joints, count = law_slope ? a->slots : a->others, *slot = w->follower;
    Row first[MAX_SLOTS];
    double M[MAX_SLOTS][MAX_SLOTS];
    for (int i = 0; i < count; i++) w->follower[i] = law_slope ? i : a->other[i];
    w->followers = count;
    jacobian(a, w);
    if (count) sweep(a, w);
    for (int i = 0; i < count; i++) {
        deflection_derivative(a, w, slot[i], M[i]);
        if (law_slope && law_slope[slot[i]] != 0) add_load_derivatives(a, w, slot[i], law_slope[slot[i]], M[i]);
        for (int j = 0; j < n; j++) first[i][j] = M[i][a->joint[j]] + w->field[a->field_axis[slot[i]]][j];
        first[i][n] = w->lack[i];
    }
    for (int i = 0; i < count; i++) {
        COPY(w->follow[i], first[i], n + 1);
        for (int k = 0; k < count; k++) add(M[i][slot[k]], first[k], n + 1, w->follow[i]);
    }
    for (int r = 0; r < 6; r++) {
        w->total[r][n] = 0;
        for (int i = 0; i < count; i++) add(w->J[r][slot[i]], w->follow[i], n + 1, w->total[r]);
    }
    for (int j = 0; j <= n && rows == 5; j++) {
        const double turn[3] = {w->total[3][j], w->total[4][j], w->total[5][j]};
        w->total[3][j] = dot(w->tcp, turn), w->total[4][j] = dot(w->tcp + 3, turn);
    }
    for (int r = 0; r < rows; r++) w->e[r] -= w->total[r][n];
}

static void move_joints(const Arm *a, const double *step, double much, double *s) {
    for (int j = 0; j < a->joints; j++) s[a->joint[j]] += much * step[j];
}
static void move(const Arm *a, const State *w, const double *step, double *s) {
    const int n = a->joints, *slot = w->follower;
    move_joints(a, step, 1, s);
    for (int i = 0; i < w->followers; i++)
        s[slot[i]] = plus_product(s[slot[i]] + w->follow[i][n], w->follow[i], step, n);
}

/* Least-squares step of the joints to w->e (Levenberg 1944), damping in m^2. Of more joints than constraints
 * it is taken through J J^T: J^T J is singular, and round-off would move the joints along what the goal leaves free. */
static void damped_step(const Arm *a, const State *w, int rows, double damping, double *step) {
    const int n = a->joints;
    Row N[MAX_JOINTS];
    factorise(w->total, rows, n, rows >= n, damping, N);
    if (rows < n) least_norm(w->total, N, rows, n, w->e, step);
    else transposed_times(w->total, rows, n, w->e, step), substitute(N, step, n);
}

/* Scales a step (n,) down to a largest element; returns the largest that it had. */
static double shortened(double *step, int n, double longest) {
    const double size = largest(step, n);
    if (size > longest) scale(longest / size, step, n);
    return size;
}

/* Newton's method in the slot amounts s, in place: the joints go to the goal, the other slots to their equilibrium.
 * Damping in proportion to the squared error keeps convergence fast and works where the Jacobian is singular
 * (Yamashita & Fukushima 2001). `limited` gives up what leads beyond the limits; `found`: not to be found again.
 * `side`: of arrival, where known. Returns 1 if the goal is reached. */
static int newton(const Arm *a, const double *goal, int rows, const int *side, double *s, State *w, Found *found,
                  int limited) {
    enum { MOST_STEPS = 40, PATIENCE = 4 };
    const double least_damping = 1e-3, tiny = 1e-15, nearly = 1e-5;
    double before = INFINITY, damping = least_damping, best = INFINITY;
    int since = 0;
    for (int step = 0;; step++, found->steps++) {
        double turns[MAX_JOINTS], q[MAX_JOINTS];
        forward(a, s, w);
        const double square = goal_error(goal, rows, w), miss = sqrt(square) + lacking(a, s, side, w);
        if (miss <= CLOSE) return 1;
        if (step == MOST_STEPS || !(miss < 1e6)) return 0;
        if (miss < 0.5 * best) best = miss, since = 0;
        else if (++since >= PATIENCE) return 0;
        if (rows == 6 && miss < 1e-4)
            for (int k = 0; k < found->count; k++) if (apart(s, found->at[k].slots, a->slots) < 3e-4) return 0;
        damping = miss > before ? 30 * damping : larger(0.3 * damping, least_damping);
        before = miss;
        total_jacobian(a, rows, NULL, w);
        damped_step(a, w, rows, damping * square + tiny, turns);
        const double size = lesser(shortened(turns, a->joints, LONGEST), LONGEST);
        move(a, w, turns, s);
        if (limited && miss > nearly) {
            linear_command(a, w->tau, s, q);
            if (excess_of(a, q) > lesser(0.2, a->nonlinear_bound + size)) return 0;
        }
    }
}

/* ---------------------------------------------------------------- 6 Closed form --------------------------------- */

enum { BRANCHES = 8 };
static const double EDGE = 1e-12;  /* share of a length, or of 1, by which a goal at the edge may lie beyond it */
static const double ROUND_OFF = 1e-10; /* rad: an angle this far beyond a limit is at the limit */
static const double BARELY = 1e-8; /* square of a share: closer to a double root or a lost lever, round-off counts */

typedef struct { /* angles wanted: within the limits, modulo 2 pi near `towards`; what is arbitrary is `towards` */
    double towards[6], lower[6], upper[6];
} Window;
typedef struct {
    double q[BRANCHES][6];
    int exists, degenerate, lost[BRANCHES]; /* bits; whether some root is (nearly) double; arbitrary joint or -1 */
} Branches;

static double into_window(const Window *win, int j, double q) {
    if (fabs(q - win->towards[j]) > 0.5 * TURN) q += TURN * rint((win->towards[j] - q) / TURN);
    if (q < win->lower[j] - ROUND_OFF) q += TURN * ceil((win->lower[j] - ROUND_OFF - q) / TURN);
    if (q > win->upper[j] + ROUND_OFF) q -= TURN * ceil((q - win->upper[j] - ROUND_OFF) / TURN);
    return !(q >= win->lower[j] - ROUND_OFF) ? NAN : clipped(q, win->lower[j], win->upper[j]);
}

/* v and u (pieper.py) at an elbow angle of cosine c and sine s, for a wrist centre by its height above the first normal
 * and the square of its distance from that one's foot. */
static void at_elbow(const Form *f, double height, double square, double c, double s, double *v, double *u) {
    for (int i = 0; i < 3; i++) v[i] = f->v0[i] + f->vc[i] * c + f->vs[i] * s;
    u[0] = (square - f->a * f->a - dot(v, v)) / (2 * f->a);
    u[1] = (height - f->links[0][0] * v[2]) / f->links[0][1];
}

/* |u|^2 - |v|^2 at an elbow angle t, where the first two axes are skew: zero at a solution. */
static double skew_miss(const Form *f, double height, double square, double t) {
    double v[3], u[2];
    at_elbow(f, height, square, cos(t), sin(t), v, u);
    return u[0] * u[0] + u[1] * u[1] + v[2] * v[2] - dot(v, v);
}

/* A trigonometric polynomial of degree 2 by its coefficients of 1, cos t, sin t, cos 2t, sin 2t, or a derivative. */
static double wave(const double *w, int derivative, double t) {
    const double c = cos(t), s = sin(t), c2 = c * c - s * s, s2 = 2 * s * c;
    if (derivative == 0) return w[0] + w[1] * c + w[2] * s + w[3] * c2 + w[4] * s2;
    if (derivative == 1) return w[2] * c - w[1] * s + 2 * (w[4] * c2 - w[3] * s2);
    return -w[1] * c - w[2] * s - 4 * (w[3] * c2 + w[4] * s2);
}

/* Its zero, or that of a derivative, between two angles where the signs differ: Newton's method, bisection where that
 * leaves the bracket. */
static double zero_between(const double *w, int derivative, double low, double high) {
    const int positive = wave(w, derivative, high) > 0;
    double x = 0.5 * (low + high);
    for (int it = 0; it < 100; it++) {
        const double y = wave(w, derivative, x), slope = wave(w, derivative + 1, x);
        if ((y > 0) == positive) high = x;
        else low = x;
        double next = x - y / slope;
        if (!(next > low && next < high)) next = 0.5 * (low + high);
        if (fabs(next - x) < 1e-15) return next;
        x = next;
    }
    return x;
}

/* Its zeros. |v|^2 has no second harmonic in t, so skew_miss is a trigonometric polynomial of degree 2: its coefficients
 * follow from eight samples. Zeros lie where the sign changes between two samples, and on both sides of an extremum that
 * crosses zero between them; one that only touches it is a double zero. */
static int skew_elbow(const Form *f, double height, double square, double *t) {
    enum { HARMONIC = 8, SAMPLES = 256 }; /* so many that two extrema hardly lie between two of them */
    const double gap = TURN / SAMPLES, tiny = 1e-12 * f->length * f->length;
    double w[5] = {0}, found[2];
    int count = 0;
    for (int i = 0; i < HARMONIC; i++) {
        const double x = i * TURN / HARMONIC, y = skew_miss(f, height, square, x) * 2 / HARMONIC;
        w[0] += 0.5 * y, w[1] += y * cos(x), w[2] += y * sin(x), w[3] += y * cos(2 * x), w[4] += y * sin(2 * x);
    }
    for (int i = 0; i < SAMPLES; i++) {
        const double a = i * gap, b = a + gap, at_a = wave(w, 0, a), at_b = wave(w, 0, b);
        int zeros = 0;
        if ((at_a > 0) != (at_b > 0)) found[zeros++] = zero_between(w, 0, a, b);
        else if (wave(w, 1, a) * at_a < 0 && wave(w, 1, b) * at_b > 0) {
            const double turn = zero_between(w, 1, a, b), at_turn = wave(w, 0, turn);
            if ((at_turn > 0) != (at_a > 0))
                found[zeros++] = zero_between(w, 0, a, turn), found[zeros++] = zero_between(w, 0, turn, b);
            else if (fabs(at_turn) < tiny) found[zeros++] = turn;
        }
        for (int z = 0; z < zeros; z++) {
            int new = count < 4;
            for (int m = 0; m < count; m++) new &= fabs(remainder(found[z] - t[m], TURN)) > 1e-9;
            if (new) t[count++] = found[z];
        }
    }
    return count;
}

/* A vector seen across one joint and its link: Rx(-alpha) Rz(-t) v. */
static void across(double c, double s, const double *link, double *v) {
    const double x = c * v[0] + s * v[1], y = c * v[1] - s * v[0], z = v[2];
    v[0] = x, v[1] = link[0] * y + link[1] * z, v[2] = link[0] * z - link[1] * y;
}

/* A squared root between two bounds: below zero by round-off it is zero; missed by no more than the share `missed` of
 * its largest value it is what it was shortly before; NAN where there is none. */
static double root_of(double square, double most, double round_off, double missed) {
    if (square >= 0) return sqrt(square);
    if (square >= -round_off) return 0;
    return square >= -missed * most ? sqrt(0.02 * most) : NAN;
}

/* The branches of a pose (Pieper 1968), as pieper.py derives them, that lie in a window.
 * Bits 4, 2, 1 of a branch's number: signs of elbow, shoulder, wrist. */
static void closed_form(const Form *f, const double *g, const Window *win, double missed, Branches *out) {
    double r[9], c[3], C[3], K[3], X[3], seen[3];
    const double L2 = f->length * f->length, *link = f->links[0];
    out->exists = out->degenerate = 0;
    for (int i = 0; i < 9; i++) r[i] = g[f->backwards ? 3 * (i % 3) + i / 3 : i]; /* backwards: the goal inverted */
    COPY(c, f->centre, 3), add(-f->backwards, g + 9, 3, c), in_base(r, c, seen), add(!f->backwards, g + 9, 3, seen);
    in_base(f->frame, seen, C), add(-1, f->foot, 3, C);
    in_base(r, f->tip_x, seen), in_base(f->frame, seen, X);
    in_base(r, f->tip_z, seen), in_base(f->frame, seen, K);
    const int outward[6] = {0, 1, 2, 3, 4, 5}, inward[6] = {5, 4, 3, 2, 1, 0}, *at = f->backwards ? inward : outward;
    const double flat = C[0] * C[0] + C[1] * C[1], square = flat + C[2] * C[2];
    double elbows[4];
    int elbow_count = 2;
    if (f->shape == SKEW) elbow_count = skew_elbow(f, C[2], square, elbows), out->degenerate |= elbow_count < 4;
    else {
        double cos3 = ((f->shape == MEETING ? square : C[2]) - f->elbow[0]) / f->elbow[1];
        out->degenerate |= fabs(1 - cos3 * cos3) < BARELY;
        if (fabs(cos3) > 1 + larger(EDGE, missed)) return;
        if (fabs(cos3) > 1) cos3 = fabs(cos3) <= 1 + EDGE ? copysign(1, cos3) : copysign(0.98, cos3);
        elbows[0] = f->elbow[2] + acos(cos3), elbows[1] = f->elbow[2] - acos(cos3);
    }
    for (int elbow = 0; elbow < elbow_count; elbow++) {
        const int first = f->shape == SKEW ? 2 * elbow : 4 * elbow;
        const double t3 = elbows[elbow], q3 = into_window(win, at[2], t3 - f->offsets[1]);
        if (isnan(q3)) continue;
        const double cos3 = cos(t3), sin3 = sin(t3);
        double v[3], u[2], root = 1;
        at_elbow(f, C[2], square, cos3, sin3, v, u);
        const double round2 = v[0] * v[0] + v[1] * v[1], least = lesser(flat, round2);
        const int lost1 = flat < 1e-18 * L2, lost2 = round2 < 1e-14 * L2;
        if (f->shape != SKEW) { /* one part of u is known, the other one a root: |u| = |v| */
            const double known = u[f->shape == MEETING];
            const double other = f->shape == MEETING ? link[0] * known - link[1] * v[2] : known + f->a;
            const double inside = flat < round2 ? flat - other * other : round2 - known * known;
            root = root_of(inside, least, EDGE * f->length * (sqrt(least) + EDGE * f->length), missed);
            out->degenerate |= inside < BARELY * least;
        }
        out->degenerate |= least < 1e-10 * L2;
        if (isnan(root)) continue;
        for (int shoulder = 0; shoulder < (f->shape == SKEW || lost1 || lost2 ? 1 : 2); shoulder++) {
            if (f->shape != SKEW) u[f->shape == PARALLEL] = shoulder ? -root : root;
            const double wx = u[0] + f->a, wy = link[0] * u[1] - link[1] * v[2];
            const double free2 = win->towards[at[1]] + f->offsets[0];
            const double t2 = lost2 ? free2 : atan2(u[1] * v[0] - u[0] * v[1], u[0] * v[0] + u[1] * v[1]);
            const double t1 = lost1 ? win->towards[at[0]] : atan2(wx * C[1] - wy * C[0], wx * C[0] + wy * C[1]);
            const double q2 = into_window(win, at[1], t2 - f->offsets[0]), q1 = into_window(win, at[0], t1);
            if (isnan(q1) || isnan(q2)) continue;
            const double turn[3][2] = {{cos(t1), sin(t1)}, {cos(t2), sin(t2)}, {cos3, sin3}};
            double m[3], n[3];
            COPY(m, K, 3), COPY(n, X, 3);
            for (int k = 0; k < 3; k++)
                across(turn[k][0], turn[k][1], f->links[k], m), across(turn[k][0], turn[k][1], f->links[k], n);
            const double *l4 = f->links[3], *l5 = f->links[4];
            double cos5 = (l4[0] * l5[0] - m[2]) / (l4[1] * l5[1]);
            const double lever = m[0] * m[0] + m[1] * m[1];
            const int lost4 = lever < 1e-18;
            out->degenerate |= fabs(1 - cos5 * cos5) < BARELY || lever < BARELY;
            if (fabs(cos5) > 1 + larger(EDGE, missed)) continue;
            if (fabs(cos5) > 1) cos5 = fabs(cos5) <= 1 + EDGE ? copysign(1, cos5) : copysign(0.98, cos5);
            double sin5 = l5[1] * sqrt(larger(1 - cos5 * cos5, EDGE * EDGE));
            const double side = -l4[0] * cos5 * l5[1] - l4[1] * l5[0];
            for (int wrist = 0; wrist < (lost4 ? 1 : 2); wrist++, sin5 = -sin5) {
                const int number = first + 2 * shoulder + wrist;
                const double free4 = win->towards[at[3]] + f->offsets[2];
                const double t4 = lost4 ? free4 : atan2(sin5 * m[1] - side * m[0], sin5 * m[0] + side * m[1]);
                const double q4 = into_window(win, at[3], t4 - f->offsets[2]);
                if (isnan(q4)) continue;
                double tip[3] = {m[0], m[1], m[2]}, end[3] = {n[0], n[1], n[2]};
                across(cos(t4), sin(t4), l4, tip);
                const double t5 = atan2(tip[0], -tip[1]), q5 = into_window(win, at[4], t5 - f->offsets[3]);
                if (isnan(q5)) continue;
                across(cos(t4), sin(t4), l4, end), across(cos(t5), sin(t5), l5, end);
                const double q6 = into_window(win, at[5], atan2(end[1], end[0]));
                if (isnan(q6)) continue;
                const double q[6] = {q1, q2, q3, q4, q5, q6};
                for (int k = 0; k < 6; k++) out->q[number][at[k]] = q[k];
                out->exists |= 1 << number;
                out->lost[number] = lost1 ? at[0] : lost2 ? at[1] : lost4 ? at[3] : -1;
            }
        }
    }
}

/* Angles within the limits, or any. */
static Window window_of(const Arm *a, const double *towards, int limited) {
    Window out;
    for (int j = 0; j < 6; j++) {
        out.towards[j] = towards ? towards[j] : 0.5 * (a->lower[j] + a->upper[j]);
        out.lower[j] = limited ? a->lower[j] : -INFINITY, out.upper[j] = limited ? a->upper[j] : INFINITY;
    }
    return out;
}

/* ---------------------------------------------------------------- 7 Seeds: singular directions, library of poses -- */

/* The joint motion (largest element 1) that moves the tool least by w->total, and the tool's direction then; returns its
 * speed (m/rad): up to that scale the smallest singular value, by inverse iteration (Wielandt 1944). */
static double slowest(const Arm *a, const State *w, double *along, double *direction) {
    const int n = a->joints;
    Row N[MAX_JOINTS];
    factorise(w->total, 6, n, 1, 1e-15, N);
    for (int j = 0; j < n; j++) along[j] = 1 + 0.3 * j;
    for (int it = 0; it < 4; it++) substitute(N, along, n), scale(1 / larger(largest(along, n), 1e-300), along, n);
    times(w->total, 6, n, along, direction);
    const double speed = length(direction, 6);
    for (int r = 0; r < 6; r++) direction[r] /= larger(speed, 1e-300);
    return speed;
}

/* Slot amounts of an arm at true joint angles (or commands) q, the other slots where searches begin. */
static void start_at(const Arm *a, const double *q, double *s) {
    COPY(s, a->start, a->slots);
    for (int j = 0; j < a->joints; j++) s[a->joint[j]] = a->zero[a->joint[j]] + q[j];
}

/* Inserts a number by its key into those with the least keys, ascending, at most `most`; returns how many there are. */
static int ranked(double key, int number, int most, int count, double *keys, int *numbers) {
    if (count == most && !(key < keys[count - 1])) return count;
    int k = count < most ? count++ : count - 1;
    for (; k > 0 && keys[k - 1] > key; k--) keys[k] = keys[k - 1], numbers[k] = numbers[k - 1];
    keys[k] = key, numbers[k] = number;
    return count;
}

/* Numbers of the poses of the library closest to a goal by their squared distance (m^2), turns by their chords, and,
 * unless NULL, to commands `towards`; the closest first, at most `most`. Returns how many there are. */
static int closest(const Arm *a, const double *goal, int rows, const double *towards, int most, int *numbers) {
    const int M = a->poses, n = a->joints;
    float far[MAX_POSES] = {0};
    double keys[RANKED];
    int count = 0;
    for (int k = rows == 6 ? 0 : rows == 5 ? 6 : 9; k < 12; k++) {
        const float g = (float)goal[k], weight = k < 9 ? (float)(LEVER * LEVER) : 1.0f;
        const float *column = a->library_columns + (size_t)k * (size_t)M;
        for (int i = 0; i < M; i++) far[i] += weight * (column[i] - g) * (column[i] - g);
    }
    for (int i = 0; i < M; i++) {
        const double beside = towards ? square_distance(a->library_q + n * i, towards, n) : 0;
        count = ranked(300 * far[i] + beside, i, most, count, keys, numbers);
    }
    return count;
}

/* ---------------------------------------------------------------- 8 Poses: all branches ------------------------- */

/* The command for the state of an arm, and the sides its joints arrive from, coming from `near` (or NULL: UNKNOWN): a
 * side follows from the command and changes it; where that contradicts itself the joint has to make a detour. */
static int command_from(const Arm *a, const State *w, const double *s, const double *near, Solution *out) {
    for (int j = 0; j < a->joints; j++) out->side[j] = out->detour[j] = 0;
    if (!command(a, w->tau, s, out->side, out->q)) return 0;
    if (!near) return 1;
    for (int j = 0; j < a->joints; j++) out->side[j] = sign(out->q[j] - near[j]);
    for (int round = 0, wrong = 1; round < 3 && wrong; round++) {
        for (int j = 0; j < a->joints; j++) if (out->detour[j]) out->side[j] = -out->side[j];
        if (!command(a, w->tau, s, out->side, out->q)) return 0;
        wrong = 0;
        for (int j = 0; j < a->joints; j++) wrong |= out->detour[j] = sign(out->q[j] - near[j]) != out->side[j];
    }
    return 1;
}

/* Keeps a state that reaches the goal, unless it is known or far outside the limits. Laws that only Python knows change
 * a command by no more than the nonlinear bound; it then decides about the limits. A residual field is of the command:
 * where that depends on `near` (or NULL), the state has to stay, s in place, as the joints arrive from there. */
static void keep(const Arm *a, const double *goal, int rows, const double *near, double same, double *s, State *w,
                 Found *found) {
    double along[MAX_JOINTS], direction[6];
    if (found->count == MAX_FOUND) return;
    Solution *new = found->at + found->count;
    if (a->terms && a->laws && near)
        if (!command_from(a, w, s, near, new) || !newton(a, goal, rows, new->side, s, w, found, 0)) return;
    linear_command(a, w->tau, s, new->q);
    if (excess_of(a, new->q) > SLACK || !command_from(a, w, s, near, new)) return;
    for (int k = 0; k < found->count; k++) if (apart(new->q, found->at[k].q, a->joints) <= same) return;
    new->excess = excess_of(a, new->q) - (a->laws_known ? AT_LIMIT : AT_LIMIT + a->nonlinear_bound);
    if (new->excess > SLACK) return;
    COPY(new->slots, s, a->slots), COPY(new->tau, w->tau, a->slots);
    if (rows >= a->joints) jacobian(a, w);
    new->slope = rows < a->joints ? -1 : slowest(a, w, along, direction);
    new->free = new->slope >= 0;
    for (int j = 1; j < a->joints && new->free; j++)
        if (fabs(along[j]) > 1.000001 * fabs(along[new->free - 1])) new->free = j + 1;
    found->count++;
}
static void attempt(const Arm *a, const double *goal, const double *near, double *s, int limited, Found *found) {
    State w;
    if (newton(a, goal, 6, UNKNOWN, s, &w, found, limited)) keep(a, goal, 6, near, SAME, s, &w, found);
}
static int solved(const Found *found) {
    int out = 0;
    for (int k = 0; k < found->count; k++) out += found->at[k].excess <= 0;
    return out;
}

/* One step of continuation: at slot amounts s where the goal is missed by LEVER lambda u, the least correction (joints,
 * lambda) that holds this, and the unit tangent `ahead` of all that does, in place. Bordered by u, the whole Jacobian is
 * regular at a fold as well (Keller 1977). */
static void along_fold(const Arm *a, const double *goal, const double *u, double lambda, const double *s, State *w,
                       double *correction, double *ahead) {
    const int n = a->joints;
    Row A[6], N[6];
    double y[6], beside[MAX_JOINTS + 1];
    forward(a, s, w), goal_error(goal, 6, w), lacking(a, s, UNKNOWN, w), total_jacobian(a, 6, NULL, w);
    for (int r = 0; r < 6; r++) COPY(A[r], w->total[r], n), A[r][n] = LEVER * u[r];
    for (int r = 0; r < 6; r++) y[r] = w->e[r] - lambda * A[r][n];
    factorise(A, 6, n + 1, 0, 1e-12, N), least_norm(A, N, 6, n + 1, y, correction);
    times(A, 6, n + 1, ahead, y), least_norm(A, N, 6, n + 1, y, beside), add(-1, beside, n + 1, ahead);
    scale(1 / larger(length(ahead, n + 1), 1e-300), ahead, n + 1);
}

/* Seeds across a fold, where two solutions merge (Borrel & Liegeois 1986), from solution number `k`: along the curve on
 * which the goal is missed in one direction u alone, that in which the tool moves least, to both sides. Where what is
 * missed changes sign, or turns, a solution is near. */
static void fold_seeds(const Arm *a, const double *goal, const double *near, int k, Found *found) {
    const double near_fold = 1e-2, first = 0.02, longest = 0.2, farthest = 4, most_missed = 0.05, seen = 1e-8;
    const double *old = found->at[k].slots;
    const int n = a->joints;
    State w;
    double along[MAX_JOINTS], u[6];
    forward(a, old, &w), goal_error(goal, 6, &w), lacking(a, old, UNKNOWN, &w), total_jacobian(a, 6, NULL, &w);
    if (slowest(a, &w, along, u) >= near_fold) return;
    for (int way = -1; way <= 1; way += 2) {
        double s[MAX_SLOTS], ahead[MAX_JOINTS + 1] = {0}, lambda = 0, before = 0, stride = first, most = 0;
        COPY(s, old, a->slots), add(way, along, n, ahead);
        for (double x = 0; x < farthest; x += stride, found->steps++) {
            double step[MAX_JOINTS + 1], q[MAX_JOINTS], seed[MAX_SLOTS];
            const double slope = ahead[n];
            along_fold(a, goal, u, lambda, s, &w, step, ahead);
            linear_command(a, w.tau, s, q);
            lambda += step[n];
            const double off = largest(step, n), was = before != 0 ? before : slope;
            if (excess_of(a, q) > 0.2 || !(off < 0.3 && fabs(lambda) < most_missed)) break;
            const int crossed = was * lambda < 0, turned = slope * was < 0 && ahead[n] * lambda > 0;
            most = larger(most, larger(fabs(lambda), stride * fabs(slope)));
            if (x > 0 && most > seen && (crossed || turned)) { /* not along a family that all reaches the goal */
                const double share = before != 0 ? lambda / (was - lambda) : 2 * slope / (slope - ahead[n]) - 1;
                COPY(seed, s, a->slots), move_joints(a, ahead, crossed ? share * stride : 0, seed);
                attempt(a, goal, near, seed, 1, found);
            }
            if (x > 0) {
                const double growth = off < 0.02 * stride ? 2 : off > 0.08 * stride ? 0.5 : 1;
                stride = clipped(growth * stride, first, longest), before = lambda;
            }
            lambda += stride * ahead[n];
            add(stride, ahead, n, step), move(a, &w, step, s);
        }
    }
}

/* Seeds for a branch that the closed form has outside the limits although the deflected arm has it within: where axes
 * are aligned, joints turn against each other along the null space, and small deflections decide how far. */
static void null_space_seeds(const Arm *a, const double *goal, const double *near, const double *q, Found *found) {
    State w;
    double at[MAX_SLOTS], s[MAX_SLOTS], along[MAX_JOINTS], direction[6];
    start_at(a, q, at);
    forward(a, at, &w), jacobian(a, &w);
    if (slowest(a, &w, along, direction) > 0.01) return;
    for (double x = -4; x <= 4; x += 0.8) {
        double there[MAX_JOINTS];
        COPY(there, q, a->joints), add(x, along, a->joints, there);
        COPY(s, at, a->slots), move_joints(a, along, x, s);
        if (excess_of(a, there) <= 0.1) attempt(a, goal, near, s, 1, found);
    }
}

/* All branches of a pose: Newton's method from the closed form of the arm that looks like this one, from null-space
 * seeds, from across folds and from poses of the library; the more of these, the less was found, and at last until one
 * solves the goal. near: present commands, or NULL. Returns the number of solutions within the limits. */
API int ik_pose(const Arm *a, const double *goal, const double *near, Found *found) {
    Branches b;
    double s[MAX_SLOTS];
    int done = 0;
    found->count = found->steps = b.exists = 0;
    if (a->has_form) {
        const Window all = window_of(a, NULL, 0);
        closed_form(&a->form, goal, &all, INFINITY, &b);
    }
    for (int k = 0; k < BRANCHES; k++) {
        if (!(b.exists >> k & 1) || excess_of(a, b.q[k]) > SLACK) continue;
        start_at(a, b.q[k], s), attempt(a, goal, near, s, 1, found);
    }
    if (near) start_at(a, near, s), attempt(a, goal, near, s, 1, found);
    for (int k = 0; k < BRANCHES; k++)
        if (b.exists >> k & 1 && excess_of(a, b.q[k]) > SLACK) null_space_seeds(a, goal, near, b.q[k], found);
    while (done < found->count) fold_seeds(a, goal, near, done++, found);
    for (int last = 0; last < 2 && !(last && solved(found)); last++) {
        int close[RANKED];
        const int held = closest(a, goal, 6, NULL, a->has_form && !last ? 6 : 96, close);
        for (int k = 0; k < held && !(last && solved(found)); k++) {
            COPY(s, a->library_slots + close[k] * a->slots, a->slots);
            attempt(a, goal, near, s, !last, found);
        }
        while (done < found->count) fold_seeds(a, goal, near, done++, found);
    }
    return solved(found);
}

/* ---------------------------------------------------------------- 9 Goals that leave motion free --------------- */

/* From s, in place, to the command nearest to `towards` that reaches the goal: least squares of joint motions subject
 * to the linearised goal, step after step, joints stopping at their limits (sequential quadratic programming with an
 * active set); at last Newton's method alone. Returns 1 if it ends there. */
static int slide(const Arm *a, const double *goal, int rows, const double *towards, double *s, State *w,
                 Found *found) {
    const int n = a->joints;
    double before = INFINITY, share = 1, by_laws[MAX_JOINTS] = {0}; /* what laws add to commands: it changes slowly */
    int settled = 0;
    for (int step = 0; step < 120; step++, found->steps++) {
        double q[MAX_JOINTS], wish[MAX_JOINTS], turn[MAX_JOINTS], y[6];
        Row free[6], N[6];
        int changed = 1;
        forward(a, s, w);
        const double square = goal_error(goal, rows, w), miss = sqrt(square) + lacking(a, s, UNKNOWN, w);
        if (!(miss < 1e6)) return 0;
        linear_command(a, w->tau, s, q);
        if (miss <= CLOSE && settled) return 1;
        if (a->laws && (step % 8 == 0 || settled)) {
            if (!command(a, w->tau, s, UNKNOWN, by_laws)) COPY(by_laws, q, n);
            for (int j = 0; j < n; j++) by_laws[j] -= q[j];
        }
        for (int j = 0; j < n; j++) q[j] += by_laws[j];
        for (int k = 0; k < found->count && miss < 1e-3; k++)
            if (apart(q, found->at[k].q, n) < ONE_FAMILY) return 0;
        total_jacobian(a, rows, NULL, w);
        const double cost = square_distance(towards, q, n);
        share = cost + 100 * miss > before ? 0.5 * share : lesser(1, 1.5 * share);
        before = cost + 100 * miss;
        for (int j = 0; j < n; j++) wish[j] = settled ? 0 : share * (towards[j] - q[j]);
        COPY(free, w->total, rows); /* columns of the joints that have not stopped */
        for (int round = 0; round < n && changed; round++) {
            changed = 0;
            times(w->total, rows, n, wish, y);
            for (int r = 0; r < rows; r++) y[r] = w->e[r] - y[r];
            factorise(free, rows, n, 0, 1e-9 + 1e-2 * square, N), least_norm(free, N, rows, n, y, turn);
            for (int j = 0; j < n; j++) {
                turn[j] += wish[j];
                const double within = clipped(turn[j], a->lower[j] - q[j], a->upper[j] - q[j]);
                if (within == turn[j]) continue;
                turn[j] = wish[j] = within, changed = 1;
                for (int r = 0; r < rows; r++) free[r][j] = 0;
            }
        }
        const double size = shortened(turn, n, 0.7);
        move(a, w, turn, s);
        settled |= size < 1e-4 * share || step > 90;
    }
    return 0;
}

/* Commands that reach a goal of `rows` constraints nearest to `towards`, from `starts` poses of the library that are
 * close to both, from `towards` itself and from `near` (or NULL). Returns the number within the limits. */
API int ik_free(const Arm *a, const double *goal, int rows, const double *towards, const double *near, int starts,
                Found *found) {
    int close[RANKED];
    found->count = found->steps = 0;
    const int held = closest(a, goal, rows, towards, starts, close);
    for (int k = -2; k < held; k++) {
        State w;
        double s[MAX_SLOTS];
        const double *from = k == -2 ? near : towards;
        if (k >= 0) COPY(s, a->library_slots + close[k] * a->slots, a->slots);
        else if (from) start_at(a, from, s);
        else continue;
        if (slide(a, goal, rows, towards, s, &w, found)) keep(a, goal, rows, near, ONE_FAMILY, s, &w, found);
    }
    return solved(found);
}

/* ---------------------------------------------------------------- 10 Nearest reachable goal --------------------- */

/* Square of the error (m^2) of a command's equilibrium, amounts s in place; infinite where there is none. */
static double settled_error(const Arm *a, const double *goal, int rows, const double *q, double *s, State *w) {
    if (settle(a, q, UNKNOWN, 1e-7, s, w) < 0) return INFINITY;
    forward(a, s, w);
    return goal_error(goal, rows, w);
}

/* w->total and w->follow of commands: all slots follow, the joints by their springs and the slopes of their laws. */
static void command_jacobian(const Arm *a, int rows, const double *q, State *w) {
    const double h = 1e-5;
    double more[MAX_SLOTS], less[MAX_SLOTS], up[MAX_JOINTS], down[MAX_JOINTS], law_slope[MAX_SLOTS] = {0};
    for (int v = 0; v < a->slots; v++) w->lack[v] = 0, more[v] = w->tau[v] + h, less[v] = w->tau[v] - h;
    joint_errors(a, more, q, UNKNOWN, up), joint_errors(a, less, q, UNKNOWN, down);
    displacement(a, q, w->field);
    for (int j = 0; j < a->joints && a->laws; j++) {
        const int v = a->joint[j];
        law_slope[v] = (up[j] - down[j] - spring_amount(a, more, v) + spring_amount(a, less, v)) / (2 * h);
    }
    total_jacobian(a, rows, law_slope, w);
}

/* Damped least squares (Levenberg 1944) over the commands q within the limits, in place: a joint that would leave its
 * limit stays. Returns the square of the error (m^2). */
static double descend(const Arm *a, const double *goal, int rows, double *q, double *s, int steps, Found *found) {
    const int n = a->joints;
    State w, next;
    double damping = 1e-2, f = settled_error(a, goal, rows, q, s, &w);
    for (int it = 0; it < steps && f < INFINITY; it++) {
        double gradient[MAX_JOINTS], moved[MAX_JOINTS], there[MAX_SLOTS], top = 0, new = INFINITY;
        command_jacobian(a, rows, q, &w);
        transposed_times(w.total, rows, n, w.e, gradient);
        for (int j = 0; j < n; j++) {
            const int stuck = (q[j] <= a->lower[j] && gradient[j] < 0) || (q[j] >= a->upper[j] && gradient[j] > 0);
            double square = 0;
            for (int r = 0; r < rows; r++) w.total[r][j] *= !stuck, square += w.total[r][j] * w.total[r][j];
            top = larger(top, square);
        }
        for (int tries = 0; tries < 20 && !(new < f); tries++) {
            double step[MAX_JOINTS];
            damped_step(a, &w, rows, damping * top, step);
            shortened(step, n, 0.7);
            for (int j = 0; j < n; j++)
                moved[j] = clipped(q[j] + step[j], a->lower[j], a->upper[j]), step[j] = moved[j] - q[j];
            if (plus_product(0, step, gradient, n) < 1e-11 * f || largest(step, n) < 1e-9) return f;
            COPY(there, s, a->slots), move(a, &w, step, there);
            new = settled_error(a, goal, rows, moved, there, &next), found->steps++;
            damping = new < f ? 0.1 * damping : larger(5 * damping, 1e-3);
        }
        if (!(new < f)) return f;
        COPY(q, moved, n), COPY(s, there, a->slots);
        f = new, w = next;
    }
    return f;
}

/* The command within the limits whose tool is nearest to a goal: short descents from `more` commands given and from the
 * closest poses of the library, long ones from the best `kept`. Solution 0 is the answer, its excess the error (m). */
API int ik_nearest(const Arm *a, const double *goal, int rows, int starts, int kept, int more, const double *from,
                   Found *found) {
    int close[MOST_STARTS], order[MOST_STARTS], ordered = 0;
    Solution start[MOST_STARTS];
    double f[MOST_STARTS], best = INFINITY;
    found->count = found->steps = 0;
    more = more < MOST_STARTS ? more : MOST_STARTS, starts = starts < MOST_STARTS - more ? starts : MOST_STARTS - more;
    const int count = more + closest(a, goal, rows, NULL, starts, close);
    for (int k = 0; k < count; k++) {
        double *q = start[k].q, *s = start[k].slots;
        COPY(q, k < more ? from + k * a->joints : a->library_q + close[k - more] * a->joints, a->joints);
        for (int j = 0; j < a->joints; j++) q[j] = clipped(q[j], a->lower[j], a->upper[j]);
        if (k < more) start_at(a, q, s);
        else COPY(s, a->library_slots + close[k - more] * a->slots, a->slots);
        ordered = ranked(descend(a, goal, rows, q, s, 6, found), k, count, ordered, f, order);
    }
    for (int k = 0, went = 0; k < ordered && went < kept && f[k] < INFINITY; k++) {
        Solution *one = start + order[k];
        int new = 1;
        for (int m = 0; m < k; m++) new &= apart(start[order[m]].q, one->q, a->joints) > 0.05;
        if (!new) continue;
        went++;
        const double error = descend(a, goal, rows, one->q, one->slots, 100, found);
        if (error < best) best = error, one->excess = sqrt(error), found->at[0] = *one, found->count = 1;
    }
    return found->count;
}

/* ---------------------------------------------------------------- 11 Batches ------------------------------------ */

API unsigned ik_source(void) { return SOURCE_CRC; }
API size_t ik_size(int which) { return which ? sizeof(Found) : sizeof(Arm); }

/* Tool frames (K,12) and loads (K,slots) at slot amounts (K,slots); or, unless NULL, the frames before the first slot
 * `after` each one (K,slots+1,12) instead. */
API void ik_forward(const Arm *a, int count, const double *s, double *tcp, double *tau, double *after) {
    State w;
    for (int k = 0; k < count; k++) {
        if (after) { place(a, s + k * a->slots, &w, after + 12 * (a->slots + 1) * k); continue; }
        forward(a, s + k * a->slots, &w);
        COPY(tcp + 12 * k, w.tcp, 12), COPY(tau + k * a->slots, w.tau, a->slots);
    }
}
/* Derivatives of the loads, (slots, slots), at slot amounts. */
API void ik_load_derivatives(const Arm *a, const double *s, double *out) {
    State w;
    forward(a, s, &w), sweep(a, &w);
    memset(out, 0, (size_t)(a->slots * a->slots) * sizeof *out);
    for (int u = 0; u < a->slots; u++) add_load_derivatives(a, &w, u, 1, out + u * a->slots);
}

/* Equilibria of commands q (K,n) with sides (K,n): slot amounts (K,slots), from those given; tool frames (K,12);
 * iterations (K,), -1 where there is none. */
API void ik_settle(const Arm *a, int count, const double *q, const int *side, double tolerance, double *s,
                   double *tcp, int *iterations) {
    State w;
    for (int k = 0; k < count; k++) {
        const int n = a->joints;
        iterations[k] = settle(a, q + k * n, side + k * n, tolerance, s + k * a->slots, &w);
        if (iterations[k] > 0 && too_soft(a, q + k * n, side + k * n, s + k * a->slots)) iterations[k] = -1;
        place(a, s + k * a->slots, &w, NULL);
        COPY(tcp + 12 * k, w.tcp, 12);
    }
}
/* Newton's method from slot amounts s, in place, without limits: 1 if it reaches the goal; the loads there in tau, the
 * command, unless it is far outside the limits, in found. */
API int ik_newton(const Arm *a, const double *goal, int rows, const double *near, double *s, double *tau,
                  Found *found) {
    State w;
    found->count = found->steps = 0;
    if (!newton(a, goal, rows, UNKNOWN, s, &w, found, 0)) return 0;
    keep(a, goal, rows, near, SAME, s, &w, found);
    COPY(tau, w.tau, a->slots);
    return 1;
}
/* The command (n,) that holds the joints at their amounts in s, each arriving from a side; the other slots, in place, and
 * the loads tau as they are then. 0 if the other slots, or the laws of the command, do not settle. */
API int ik_hold(const Arm *a, const int *side, double *s, double *tau, double *q) {
    State w;
    Memory memory = {.known = 0};
    for (int it = 1; it <= 300; it++) {
        double x[MAX_SLOTS];
        forward(a, s, &w);
        const double miss = lacking(a, s, side, &w);
        if (!(miss < 1e6)) return 0;
        if (miss <= CLOSE) {
            COPY(tau, w.tau, a->slots);
            return command(a, w.tau, s, side, q);
        }
        for (int i = 0; i < a->others; i++) x[i] = s[a->other[i]];
        if (it <= 20) accelerate(&memory, x, w.lack, a->others);
        else add(it > 60 ? 0.4 : 1, w.lack, a->others, x);
        for (int i = 0; i < a->others; i++) s[a->other[i]] = x[i];
    }
    return 0;
}
/* Whether joints can move without the tool, at a state of an arm that nothing deflects. */
static int aligned(const Arm *a, State *w) {
    double along[MAX_JOINTS], direction[6];
    jacobian(a, w);
    return slowest(a, w, along, direction) < 1e-7 * a->form.length;
}
/* Slot amounts s of the member nearest to `towards` of the family of branch `k`, of those within the limits that have
 * the free joint at one of some angles. 1 if there is one. From a member far outside the limits `slide` may not arrive,
 * or at another branch: a joint that stops there leaves the aligned arm without the motion that it lacks. */
static int family_member(const Arm *a, const double *goal, const double *towards, int k, int joint, double *s) {
    const int angles = 24;
    double best = INFINITY;
    Window open = window_of(a, towards, 0);
    Branches b;
    for (int m = 0; m <= angles; m++) {
        open.towards[joint] = a->lower[joint] + (a->upper[joint] - a->lower[joint]) * m / angles;
        closed_form(&a->form, goal, &open, 0, &b);
        const double far = b.exists >> k & 1 && excess_of(a, b.q[k]) <= 0 ? square_distance(b.q[k], towards, 6) : INFINITY;
        if (far < best) best = far, start_at(a, b.q[k], s);
    }
    return best < INFINITY;
}
/* One pose of an arm that nothing deflects: its branches q (8,6) and kind (8,): -1 none, 0 alone, else the joint from 1
 * that is free along the branch's family. Beyond the limits too unless `limited`. Where a root is nearly double or a
 * lever nearly lost, Newton's method follows, and a family is represented by its member nearest to `towards`. */
static void nominal_pose(const Arm *a, const double *goal, const double *towards, int limited, double *q, int *kind) {
    const Window open = window_of(a, towards, 0), within = window_of(a, towards, limited);
    Branches b;
    closed_form(&a->form, goal, &within, 0, &b);
    if (b.degenerate && limited) closed_form(&a->form, goal, &open, 0, &b);
    for (int k = 0; k < BRANCHES; k++) {
        kind[k] = b.exists >> k & 1 ? 0 : -1;
        if (kind[k] == 0) COPY(q + 6 * k, b.q[k], 6);
        if (kind[k] < 0 || !b.degenerate) continue;
        Found scratch;
        State w;
        double s[MAX_SLOTS], member[MAX_SLOTS];
        scratch.count = scratch.steps = 0;
        start_at(a, b.q[k], s);
        if (!newton(a, goal, 6, UNKNOWN, s, &w, &scratch, 0)) kind[k] = -1;
        if (kind[k] == 0 && aligned(a, &w)) {
            kind[k] = b.lost[k] + 1;
            for (int from = 0, there = !kind[k]; from < 2 && !there; from++) {
                if (!from) COPY(member, s, a->slots);
                else if (!family_member(a, goal, towards, k, b.lost[k], member)) break;
                there = slide(a, goal, 6, towards, member, &w, &scratch) && aligned(a, &w);
                if (there) COPY(s, member, a->slots);
            }
        }
        for (int j = 0; j < 6 && kind[k] >= 0; j++) {
            const double angle = into_window(&within, j, s[a->joint[j]] - a->zero[a->joint[j]]);
            if (isnan(angle)) kind[k] = -1;
            q[6 * k + j] = isnan(angle) ? 0 : angle;
        }
        for (int m = 0; m < k && kind[k] >= 0; m++)
            if (kind[m] >= 0 && apart(q + 6 * k, q + 6 * m, 6) <= SAME) kind[k] = -1;
    }
}
/* All branches of poses (K,12); `margin` (K,8), or NULL: rad from the nearest limit, negative beyond it. */
API void ik_nominal(const Arm *a, int count, const double *goals, const double *towards, int limited, double *q,
                    int *kind, double *margin) {
    for (int k = 0; k < count; k++) nominal_pose(a, goals + 12 * k, towards, limited, q + 48 * k, kind + 8 * k);
    for (int k = 0; margin && k < 8 * count; k++) margin[k] = -excess_of(a, q + 6 * k);
}

/* Of a cube of points^3 goals about `centre` for the arm as drawn, within the limits of the deflected one, that whose
 * equilibrium is nearest to `target` (Conenna 2024, section 7.2). From one goal to another the tool's offset from it
 * changes by less than half of their distance unless the arm is near its limits. So, from the middle one on, goals
 * whose bound (Shubert 1972) is above the best are passed over; all are settled if the best is further off than the
 * grid is wide. q, s: a command and its slots at rest, in place. 1, or 0 where no goal has both. */
API int ik_cube(const Arm *a, const Arm *drawn, const double *centre, double side, int points, const double *target,
                double tolerance, double *q, double *s) {
    const Window win = window_of(a, q, 1);
    const int count = points * points * points;
    double goal[12], last[6], slots[MAX_SLOTS], there[MAX_SLOTS], offset[3] = {0}, from[3], best = INFINITY;
    State w;
    Branches b;
    COPY(last, q, 6), COPY(slots, s, a->slots), COPY(goal, centre, 12), COPY(from, centre + 9, 3);
    for (int k = 0; k < 2 * count && (k < count || best > side / (points - 1)); k++) {
        const int i = (k + count / 2) % count, step[3] = {i / (points * points), i / points % points, i % points};
        double command_[6], off[3], least = INFINITY; /* the nominal branch nearest to the first command */
        for (int x = 0; x < 3; x++) {
            goal[9 + x] = centre[9 + x] + side * ((double)step[x] / (points - 1) - 0.5);
            off[x] = goal[9 + x] + offset[x] - target[x];
        }
        if (k < count && length(off, 3) - 0.5 * distance(goal + 9, from) > best + 0.1 * tolerance) continue;
        closed_form(&drawn->form, goal, &win, 0, &b);
        for (int n = 0; n < BRANCHES; n++) {
            const double turn = b.exists >> n & 1 ? apart(b.q[n], win.towards, 6) : INFINITY;
            if (turn < least) least = turn, COPY(command_, b.q[n], 6);
        }
        if (least == INFINITY) continue;
        COPY(there, slots, a->slots);
        for (int j = 0; j < 6; j++) there[a->joint[j]] += command_[j] - last[j];
        if (settle(a, command_, UNKNOWN, tolerance, there, &w) < 0) continue;
        place(a, there, &w, NULL);
        for (int x = 0; x < 3; x++) from[x] = goal[9 + x], offset[x] = w.tcp[9 + x] - from[x];
        COPY(slots, there, a->slots), COPY(last, command_, 6);
        const double error = distance(w.tcp + 9, target);
        if (error < best) best = error, COPY(q, command_, 6), COPY(s, there, a->slots);
    }
    return best < INFINITY;
}
