/* What the C flights share: groups of trials, random numbers and elementary functions, with the arithmetic of
 * src/marsedl/montecarlo, operation by operation. Compiled without contraction and reordering, so that the bits agree. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#define LANES 64
#define EACH_LANE for (int lane = 0; lane < LANES; lane++)
#define INLINE static inline __attribute__((always_inline))

typedef double row_t[LANES] __attribute__((aligned(64)));

/* Of two numbers the larger one; NaN stays NaN. */
INLINE double larger(double a, double b) { return (a > b) | (a != a) ? a : b; }
INLINE double smaller(double a, double b) { return (a < b) | (a != a) ? a : b; }

INLINE int64_t bits_of(double x) { int64_t b; memcpy(&b, &x, 8); return b; }
INLINE double double_of(int64_t b) { double x; memcpy(&x, &b, 8); return x; }

/* ---- elementary functions ---- */

static const double ROUNDER = 0x1.8p52, LOG_2_HIGH = 6.93147180369123816490e-01, LOG_2_LOW = 1.90821492927058770002e-10;

INLINE double logarithm(double x) {
    int64_t bits = bits_of(x), exponent = (bits - INT64_C(0x3FE6A09E667F3BCD)) >> 52;
    double f = double_of(bits - (int64_t)((uint64_t)exponent << 52)) - 1.0, s = f / (2.0 + f), z = s * s, w = z * z;
    double even = w * (3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01));
    double odd = z * (6.666666666666735130e-01 + w * (2.857142874366239149e-01
        + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01)));
    double half_square = 0.5 * f * f, k = (double)exponent, low = s * (half_square + even + odd) + k * LOG_2_LOW;
    return k * LOG_2_HIGH - ((half_square - low) - f);
}

INLINE double exponential(double x) {
    double shifted = x * 1.44269504088896338700e00 + ROUNDER, k = shifted - ROUNDER;
    double high = x - k * LOG_2_HIGH, low = k * LOG_2_LOW, r = high - low, z = r * r;
    double tail = 6.61375632143793436117e-05 + z * (-1.65339022054652515390e-06 + z * 4.13813679705723846039e-08);
    double c = r - z * (1.66666666666666019037e-01 + z * (-2.77777777770155933842e-03 + z * tail));
    double power = double_of((int64_t)((uint64_t)(bits_of(shifted) + 1023) << 52));
    return (1.0 - ((low - (r * c) / (2.0 - c)) - high)) * power;
}

typedef struct { double sine, cosine; } pair_t;

INLINE pair_t of_quarter_turns(int64_t quarter, double x) {
    double z = x * x;
    double sine_tail = -1.98412698298579493134e-04 + z * (2.75573137070700676789e-06
        + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10));
    double sine = x + x * z * (-1.66666666666666324348e-01 + z * (8.33333333332248946124e-03 + z * sine_tail));
    double cosine_tail = 2.48015872894767294178e-05 + z * (-2.75573143513906633035e-07
        + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11));
    double tail = z * z * (4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * cosine_tail));
    double leading = 1.0 - 0.5 * z, cosine = leading + (((1.0 - leading) - 0.5 * z) + tail);
    double first = (quarter & 1) ? cosine : sine, second = (quarter & 1) ? sine : cosine;
    pair_t both = {(quarter & 2) ? -first : first, ((quarter + 1) & 2) ? -second : second};
    return both;
}

INLINE pair_t sine_cosine(double angle) {
    double shifted = angle * 6.36619772367581382433e-01 + ROUNDER, n = shifted - ROUNDER;
    double rest = angle - n * 1.57079632673412561417e00, x = rest - n * 6.07710050630396597660e-11;
    x = x + (((rest - x) - n * 6.07710050630396597660e-11) - n * 2.02226624879595063154e-21);
    return of_quarter_turns(bits_of(shifted), x);
}

INLINE pair_t sine_cosine_of_turn(uint64_t bits) {
    int64_t quarter = (int64_t)((bits + (UINT64_C(1) << 61)) >> 62);
    int64_t remainder = (int64_t)(bits - ((uint64_t)quarter << 62)) >> 11;
    return of_quarter_turns(quarter, (double)remainder * (0x1p-53 * 6.283185307179586));
}

INLINE double arctangent(double y, double x) {
    double ahead = fabs(x), up = fabs(y);
    int first = 16.0 * up < 7.0 * ahead, second = 16.0 * up < 11.0 * ahead, third = 16.0 * up < 19.0 * ahead;
    int fourth = 16.0 * up < 39.0 * ahead, origin = ahead + up == 0.0;
    double numerator = fourth ? up - 1.5 * ahead : -ahead, denominator = fourth ? ahead + 1.5 * up : up;
    double high = fourth ? 9.82793723247329054082e-01 : 1.57079632679489655800e00;
    double low = fourth ? 1.39033110312309984516e-17 : 6.12323399573676603587e-17;
    numerator = third ? up - ahead : numerator, denominator = third ? up + ahead : denominator;
    high = third ? 7.85398163397448278999e-01 : high, low = third ? 3.06161699786838301793e-17 : low;
    numerator = second ? 2.0 * up - ahead : numerator, denominator = second ? 2.0 * ahead + up : denominator;
    high = second ? 4.63647609000806093515e-01 : high, low = second ? 2.26987774529616870924e-17 : low;
    numerator = first ? up : numerator, denominator = first ? ahead : denominator;
    high = first ? 0.0 : high, low = first ? 0.0 : low;
    double t = (origin ? 0.0 : numerator) / (origin ? 1.0 : denominator), z = t * t, w = z * z;
    double odd = 6.66107313738753120669e-02 + w * (4.97687799461593236017e-02 + w * 1.62858201153657823623e-02);
    odd = 1.42857142725034663711e-01 + w * (9.09088713343650656196e-02 + w * odd);
    odd = z * (3.33333333333329318027e-01 + w * odd);
    double even = -7.69187620504482999495e-02 + w * (-5.83357013379057348645e-02 + w * -3.65315727442169155270e-02);
    even = w * (-1.99999999998764832476e-01 + w * (-1.11111104054623557880e-01 + w * even));
    double angle = high - ((t * (odd + even) - low) - t);
    angle = origin ? 0.0 : angle;
    angle = x < 0.0 ? 3.14159265358979311600e00 - (angle - 1.22464679914735317636e-16) : angle;
    return y < 0.0 ? -angle : angle;
}

INLINE double arc_cosine(double x) { return arctangent(sqrt((1.0 - x) * (1.0 + x)), x); }

/* ---- random numbers: Philox4x64-10 and Box, Muller ---- */

INLINE void fill_normals(uint64_t seed, uint64_t stream, uint64_t first_trial, uint64_t block, double out[4][LANES]) {
    uint64_t bits[4][LANES] __attribute__((aligned(64)));
    EACH_LANE {
        uint64_t a = block, b = stream, c = first_trial + lane, d = 0, key0 = seed, key1 = 0;
        for (int round = 0; round < 10; round++) {
            unsigned __int128 first = (unsigned __int128)UINT64_C(0xD2E7470EE14C6C93) * a;
            unsigned __int128 second = (unsigned __int128)UINT64_C(0xCA5A826395121157) * c;
            a = (uint64_t)(second >> 64) ^ b ^ key0, b = (uint64_t)second;
            c = (uint64_t)(first >> 64) ^ d ^ key1, d = (uint64_t)first;
            key0 += UINT64_C(0x9E3779B97F4A7C15), key1 += UINT64_C(0xBB67AE8584CAA73B);
        }
        bits[0][lane] = a, bits[1][lane] = b, bits[2][lane] = c, bits[3][lane] = d;
    }
    for (int half = 0; half < 2; half++)
        EACH_LANE {
            double uniform = ((double)(int64_t)(bits[2 * half][lane] >> 11) + 1.0) * 0x1p-53;
            double radius = sqrt(-2.0 * logarithm(uniform));
            pair_t turn = sine_cosine_of_turn(bits[2 * half + 1][lane]);
            out[2 * half][lane] = radius * turn.cosine, out[2 * half + 1][lane] = radius * turn.sine;
        }
}

/* ---- classical Runge-Kutta: drift(number, state, out) writes the rates at the start, the middle (1) and the end (2) ---- */

#define RUNGE_KUTTA(states, step, state, drift)                                                             \
    do {                                                                                                    \
        row_t stage[states], slope[states], total[states];                                                  \
        double half = 0.5 * (step), sixth = (step) / 6.0;                                                   \
        drift(0, state, slope);                                                                             \
        for (int row = 0; row < states; row++)                                                              \
            EACH_LANE total[row][lane] = slope[row][lane], stage[row][lane] = state[row][lane] + half * slope[row][lane]; \
        for (int middle = 0; middle < 2; middle++) {                                                        \
            double length = middle ? (step) : half;                                                         \
            drift(1, stage, slope);                                                                         \
            for (int row = 0; row < states; row++)                                                          \
                EACH_LANE {                                                                                 \
                    total[row][lane] += 2.0 * slope[row][lane];                                             \
                    stage[row][lane] = state[row][lane] + length * slope[row][lane];                        \
                }                                                                                           \
        }                                                                                                   \
        drift(2, stage, slope);                                                                             \
        for (int row = 0; row < states; row++) EACH_LANE state[row][lane] += sixth * (total[row][lane] + slope[row][lane]); \
    } while (0)
