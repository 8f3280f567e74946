/* The powered descent's flights as src/marsedl/papers/powered_descent/flight.py flies them, by classical Runge-Kutta. */
#include "lanes.h"

enum { STATES = 5, OBSERVED = 2 };

typedef struct {
    const double *gain, *mean, *feedforward; /* (2 steps + 1, 2, 4), (2 steps + 1, 4), (2 steps + 1, 2) */
    double gravity, mass_flow, noise_density, step;
    int64_t steps, every, trials, first_increment; /* trials: whole groups */
    uint64_t seed, stream, first_trial;
} segment_t;

INLINE void thrusts(const segment_t *s, int64_t half, double state[][LANES], int lane, double thrust[2]) {
    const double *gain = s->gain + 8 * half, *mean = s->mean + 4 * half, *feedforward = s->feedforward + 2 * half;
    double e1 = state[0][lane] - mean[0], e2 = state[1][lane] - mean[1];
    double e3 = state[2][lane] - mean[2], e4 = state[3][lane] - mean[3];
    thrust[0] = feedforward[0] - (e1 * gain[0] + e2 * gain[1] + e3 * gain[2] + e4 * gain[3]);
    thrust[1] = feedforward[1] - (e1 * gain[4] + e2 * gain[5] + e3 * gain[6] + e4 * gain[7]);
}

INLINE double magnitude(const double thrust[2]) {
    return sqrt(thrust[0] * thrust[0] + thrust[1] * thrust[1] + 1e-300);
}

INLINE void drift(const segment_t *s, int64_t half, double state[][LANES], double noise[][LANES], double out[][LANES]) {
    EACH_LANE {
        double thrust[2], inverse_mass = 1.0 / state[4][lane];
        thrusts(s, half, state, lane, thrust);
        out[0][lane] = state[2][lane], out[1][lane] = state[3][lane];
        out[2][lane] = (thrust[0] + s->noise_density * noise[0][lane]) * inverse_mass;
        out[3][lane] = (thrust[1] + s->noise_density * noise[1][lane]) * inverse_mass - s->gravity;
        out[4][lane] = -s->mass_flow * magnitude(thrust);
    }
}

INLINE void observe(const segment_t *s, int64_t half, double state[][LANES], double seen[][LANES], double most[][LANES]) {
    EACH_LANE {
        double thrust[2];
        thrusts(s, half, state, lane, thrust);
        seen[0][lane] = magnitude(thrust), seen[1][lane] = -state[1][lane];
        most[0][lane] = larger(most[0][lane], seen[0][lane]), most[1][lane] = larger(most[1][lane], seen[1][lane]);
    }
}

INLINE void store(int64_t output, int64_t trials, int rows, double values[][LANES], double *table) {
    for (int row = 0; row < rows; row++) memcpy(table + (output * rows + row) * trials, values[row], sizeof(row_t));
}

/* state: (5, trials), replaced; history, observed: (outputs, 5 or 2, trials), filled; most: (2, trials), raised. */
void fly_segment(const segment_t *s, double *states, double *history, double *observed, double *maxima) {
    for (int64_t group = 0; group < s->trials / LANES; group++) {
        row_t state[STATES], noise[2], normals[4], seen[OBSERVED], most[OBSERVED];
        int64_t offset = group * LANES, number = 2 * s->first_increment, filled = -1;
        double scale = sqrt(s->step / 1.0) / s->step;
        for (int row = 0; row < STATES; row++) memcpy(state[row], states + row * s->trials + offset, sizeof(row_t));
        for (int row = 0; row < OBSERVED; row++) memcpy(most[row], maxima + row * s->trials + offset, sizeof(row_t));
        for (int64_t k = 0; k < s->steps; k++) {
            observe(s, 2 * k, state, seen, most);
            if (k % s->every == 0) {
                store(k / s->every, s->trials, STATES, state, history + offset);
                store(k / s->every, s->trials, OBSERVED, seen, observed + offset);
            }
            for (int component = 0; component < 2; component++, number++) {
                if (number / 4 != filled) fill_normals(s->seed, s->stream, s->first_trial + offset, filled = number / 4, normals);
                EACH_LANE noise[component][lane] = (0.0 + normals[number % 4][lane]) * scale;
            }
#define DRIFT(number, x, out) drift(s, 2 * k + (number), x, noise, out)
            RUNGE_KUTTA(STATES, s->step, state, DRIFT);
        }
        observe(s, 2 * s->steps, state, seen, most);
        store(s->steps / s->every, s->trials, STATES, state, history + offset);
        store(s->steps / s->every, s->trials, OBSERVED, seen, observed + offset);
        for (int row = 0; row < STATES; row++) memcpy(states + row * s->trials + offset, state[row], sizeof(row_t));
        for (int row = 0; row < OBSERVED; row++) memcpy(maxima + row * s->trials + offset, most[row], sizeof(row_t));
    }
}
