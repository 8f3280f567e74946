/* The entry's flights as src/marsedl/papers/stochastic_entry/flight.py flies them to the velocity trigger in the reading
 * `corrected`, outputs once a guidance period. */
#include "lanes.h"

enum { RADIUS, LONGITUDE, LATITUDE, SPEED, PATH_ANGLE, AZIMUTH, STATES };
enum { VELOCITY = 1, DRAG = 5, ALTITUDE_RATE, FEATURES };
enum { SIGHTED_CROSSRANGE, DOWNRANGE_ANGLE, CROSSRANGE_ANGLE, SIGHTED };
enum { DIRECTION, COMMAND, COMMAND_COSINE, FLOWN_BANK, FLOWN_CHANGE, ALIGNING, FLYING, STEERED };
enum { CROSSRANGE = 5, BANK_COSINE, HISTORY };
enum { END_TIME = 6, REVERSALS, NEGATIVE_DENSITIES, FINAL };
enum { SINE, COSINE, DRAG_FACTOR, LIFT_FACTOR, AERO };

typedef struct { /* `Settings` of flight.py */
    double gravitational_parameter, rotation_rate, planet_radius, target_longitude, sin_target_latitude;
    double cos_target_latitude, heading_sign, bottom, nodes_per_metre, period, largest_bank_change;
    double fast_velocity, slow_velocity, fast_cosine, slow_cosine;
    double deadband_start, deadband_start_width, deadband_end, deadband_end_width, initial_direction;
    double alignment_velocity, alignment_gain, alignment_limit_velocity, alignment_first_limit;
    double alignment_last_limit, end_velocity;
    int64_t alignment_form, limit_as_printed;
} settings_t;

typedef struct {
    const settings_t *settings;
    const double *log_density, *log_step, *deviation, *log_retention; /* (nodes,), (nodes - 1,) the last */
    const double *table, *gain, *reference, *bank_cosine;          /* of the law */
    const double *entry_state, *drag_factor, *lift_factor;         /* (6, trials), (trials,) */
    double least_drag, end_time;
    int64_t nodes, by_time, rows, cycles, substeps, trials; /* trials: whole groups */
    uint64_t seed, stream, first_trial;
} problem_t;

typedef struct {
    const problem_t *p;
    const settings_t *c;
    double (*factor)[LANES];
    row_t aero[AERO], found[2];
} flight_t;

INLINE void look_up(const flight_t *f, double altitude, int lane, double *log_density, double *factor) {
    double position = (altitude - f->c->bottom) * f->c->nodes_per_metre, last = (double)(f->p->nodes - 1);
    position = position > 0.0 ? position : 0.0;
    position = position < last ? position : last;
    int node = (int)position;
    node = node < f->p->nodes - 1 ? node : (int)(f->p->nodes - 2);
    double rest = position - node, below = f->factor[node][lane];
    *log_density = f->p->log_density[node] + rest * f->p->log_step[node];
    *factor = below + rest * (f->factor[node + 1][lane] - below);
}

INLINE void rates(const flight_t *f, int lane, const double x[STATES], double log_density, double factor, double out[STATES]) {
    const settings_t *c = f->c;
    double radius = x[RADIUS], velocity = x[SPEED], density = exponential(log_density) * factor;
    pair_t latitude = sine_cosine(x[LATITUDE]), path = sine_cosine(x[PATH_ANGLE]), azimuth = sine_cosine(x[AZIMUTH]);
    double inverse_radius = 1.0 / radius, inverse_velocity = 1.0 / velocity;
    double inverse_cos_latitude = 1.0 / latitude.cosine, inverse_cos_path = 1.0 / path.cosine;
    double gravity = c->gravitational_parameter * inverse_radius * inverse_radius, mass_flux = density * velocity;
    double angular_speed = velocity * path.cosine * inverse_radius, eastward = angular_speed * azimuth.sine;
    double centrifugal = c->rotation_rate * c->rotation_rate * radius * latitude.cosine;
    double northward_sine = latitude.sine * azimuth.cosine;
    double drag_factor = f->aero[DRAG_FACTOR][lane], lift_factor = f->aero[LIFT_FACTOR][lane];
    double inertial = eastward * latitude.sine * inverse_cos_latitude
        - 2.0 * c->rotation_rate * (path.sine * inverse_cos_path * latitude.cosine * azimuth.cosine - latitude.sine)
        + centrifugal * latitude.sine * azimuth.sine * inverse_cos_path * inverse_velocity;
    out[RADIUS] = velocity * path.sine;
    out[LONGITUDE] = eastward * inverse_cos_latitude;
    out[LATITUDE] = angular_speed * azimuth.cosine;
    out[SPEED] = -drag_factor * mass_flux * velocity - gravity * path.sine
        + centrifugal * (path.sine * latitude.cosine - path.cosine * northward_sine);
    out[PATH_ANGLE] = lift_factor * mass_flux * f->aero[COSINE][lane] + angular_speed
        - gravity * path.cosine * inverse_velocity + 2.0 * c->rotation_rate * latitude.cosine * azimuth.sine
        + centrifugal * (path.cosine * latitude.cosine + path.sine * northward_sine) * inverse_velocity;
    out[AZIMUTH] = lift_factor * mass_flux * f->aero[SINE][lane] * inverse_cos_path + c->heading_sign * inertial;
}

INLINE void drift(flight_t *f, double state[][LANES], double out[][LANES]) {
    EACH_LANE look_up(f, state[RADIUS][lane] - f->c->planet_radius, lane, &f->found[0][lane], &f->found[1][lane]);
    EACH_LANE {
        double x[STATES], slope[STATES];
        for (int row = 0; row < STATES; row++) x[row] = state[row][lane];
        rates(f, lane, x, f->found[0][lane], f->found[1][lane], slope);
        for (int row = 0; row < STATES; row++) out[row][lane] = slope[row];
    }
}

static void step_lane(const flight_t *f, double step, int lane, const double start[STATES], double end[STATES]) {
    static const double AHEAD[4] = {0.0, 0.5, 0.5, 1.0};
    double slope[STATES] = {0}, x[STATES], now[STATES], log_density, factor;
    for (int stage = 0; stage < 4; stage++) {
        for (int row = 0; row < STATES; row++) x[row] = start[row] + AHEAD[stage] * step * slope[row];
        look_up(f, x[RADIUS] - f->c->planet_radius, lane, &log_density, &factor);
        rates(f, lane, x, log_density, factor, now);
        double weight = stage == 0 || stage == 3 ? step / 6.0 : step / 3.0;
        for (int row = 0; row < STATES; row++)
            end[row] = (stage == 0 ? start[row] : end[row]) + weight * now[row], slope[row] = now[row];
    }
}

static double to_trigger(const flight_t *f, double step, int lane, const double start[STATES], double end[STATES]) {
    double lower = 0.0, upper = step, part = step, limit = f->c->end_velocity;
    double above = start[SPEED] - limit, below = end[SPEED] - limit;
    int kept = 0;
    if (above <= 0.0) {
        step_lane(f, 0.0, lane, start, end);
        return 0.0;
    }
    for (int iteration = 0; iteration < 60; iteration++) {
        part = (lower * below - upper * above) / (below - above);
        step_lane(f, part, lane, start, end);
        double excess = end[SPEED] - limit;
        if (fabs(excess) <= 1e-11) break;
        if (excess > 0.0) {
            below = kept > 0 ? 0.5 * below : below;
            lower = part, above = excess, kept = 1;
        } else {
            above = kept < 0 ? 0.5 * above : above;
            upper = part, below = excess, kept = -1;
        }
    }
    return part;
}

static void observe(flight_t *f, double state[][LANES], double feature[][LANES], double sight[][LANES]) {
    const settings_t *c = f->c;
    EACH_LANE look_up(f, state[RADIUS][lane] - c->planet_radius, lane, &f->found[0][lane], &f->found[1][lane]);
    EACH_LANE {
        double radius = state[RADIUS][lane], velocity = state[SPEED][lane];
        pair_t latitude = sine_cosine(state[LATITUDE][lane]), path = sine_cosine(state[PATH_ANGLE][lane]);
        pair_t to_target = sine_cosine(c->target_longitude - state[LONGITUDE][lane]);
        pair_t azimuth = sine_cosine(state[AZIMUTH][lane]);
        double along_meridian = c->cos_target_latitude * to_target.cosine;
        double up = latitude.cosine * along_meridian + latitude.sine * c->sin_target_latitude;
        double east = c->cos_target_latitude * to_target.sine;
        double north = latitude.cosine * c->sin_target_latitude - latitude.sine * along_meridian;
        double horizontal = velocity * path.cosine;
        double velocity_east = horizontal * azimuth.sine + c->rotation_rate * radius * latitude.cosine;
        double velocity_north = horizontal * azimuth.cosine;
        double inverse_speed = 1.0 / sqrt(velocity_east * velocity_east + velocity_north * velocity_north);
        double ahead = (east * velocity_east + north * velocity_north) * inverse_speed;
        double left = (north * velocity_east - east * velocity_north) * inverse_speed;
        double distance = arctangent(sqrt(east * east + north * north), up);
        double crossrange_angle = arctangent(left, sqrt(up * up + ahead * ahead));
        double downrange_angle = ahead < 0.0 ? -distance : distance;
        double density = exponential(f->found[0][lane]) * f->found[1][lane];
        feature[0][lane] = radius, feature[1][lane] = velocity, feature[2][lane] = state[PATH_ANGLE][lane];
        feature[3][lane] = -c->planet_radius * downrange_angle, feature[4][lane] = density;
        feature[DRAG][lane] = f->aero[DRAG_FACTOR][lane] * density * velocity * velocity;
        feature[ALTITUDE_RATE][lane] = velocity * path.sine;
        sight[SIGHTED_CROSSRANGE][lane] = c->planet_radius * crossrange_angle;
        sight[DOWNRANGE_ANGLE][lane] = downrange_angle, sight[CROSSRANGE_ANGLE][lane] = crossrange_angle;
    }
}

/* Row before a velocity in an ascending table, as numpy.searchsorted finds it from the right. */
static int64_t row_before(double velocity, const double *table, int64_t rows) {
    int64_t low = 0, high = rows;
    while (low < high) {
        int64_t middle = (low + high) / 2;
        if (table[middle] <= velocity) low = middle + 1; else high = middle;
    }
    low = low - 1 > 0 ? low - 1 : 0;
    return low < rows - 2 ? low : rows - 2;
}

static void command_cosine(const flight_t *f, int64_t cycle, double feature[][LANES], double steering[][LANES]) {
    const problem_t *p = f->p;
    const settings_t *c = f->c;
    if (p->by_time) {
        int64_t row = cycle < p->rows - 1 ? cycle : p->rows - 1;
        const double *gain = p->gain + row * FEATURES, *reference = p->reference + row * FEATURES;
        EACH_LANE {
            double command = p->bank_cosine[row];
            for (int j = 0; j < FEATURES; j++) command += gain[j] * (feature[j][lane] - reference[j]);
            steering[COMMAND_COSINE][lane] = smaller(larger(command, -1.0), 1.0);
        }
    } else
        EACH_LANE {
            double velocity = feature[VELOCITY][lane], drag = feature[DRAG][lane];
            double part = (velocity - c->slow_velocity) / (c->fast_velocity - c->slow_velocity);
            double fast = smaller(larger(part, 0.0), 1.0), command = fast * c->fast_cosine + (1.0 - fast) * c->slow_cosine;
            double gravity = c->gravitational_parameter / (feature[0][lane] * feature[0][lane]);
            int slowing = drag * velocity > -gravity * feature[ALTITUDE_RATE][lane];
            if (slowing && velocity <= p->table[p->rows - 1] && drag >= p->least_drag) {
                int64_t row = row_before(velocity, p->table, p->rows);
                double rest = (velocity - p->table[row]) / (p->table[row + 1] - p->table[row]);
                rest = rest > 0.0 ? rest : 0.0, rest = rest < 1.0 ? rest : 1.0;
                const double *gain = p->gain + row * FEATURES, *reference = p->reference + row * FEATURES;
                for (int j = 0; j < FEATURES; j++) {
                    double k = gain[j] + rest * (gain[j + FEATURES] - gain[j]);
                    command += k * (feature[j][lane] - reference[j] - rest * (reference[j + FEATURES] - reference[j]));
                }
            }
            steering[COMMAND_COSINE][lane] = smaller(larger(command, -1.0), 1.0);
        }
}

static void command_bank(const flight_t *f, double time, double feature[][LANES], double sight[][LANES],
                         double steering[][LANES], double *reversals) {
    const settings_t *c = f->c;
    int aligning = 0;
    EACH_LANE {
        int slow = feature[VELOCITY][lane] <= c->alignment_velocity;
        steering[ALIGNING][lane] = slow ? 1.0 : steering[ALIGNING][lane];
        aligning += steering[ALIGNING][lane] > 0.0;
    }
    if (aligning < LANES) {
        double rest = smaller(larger((c->deadband_end - time) / (c->deadband_end - c->deadband_start), 0.0), 1.0);
        double width = rest * c->deadband_start_width + (1.0 - rest) * c->deadband_end_width;
        EACH_LANE {
            double before = steering[DIRECTION][lane];
            double turned = before * sight[SIGHTED_CROSSRANGE][lane] > width ? -before : before;
            turned = steering[ALIGNING][lane] > 0.0 ? before : turned;
            reversals[lane] += (turned != before ? 1.0 : 0.0) * steering[FLYING][lane];
            steering[DIRECTION][lane] = turned;
            steering[COMMAND][lane] = turned * arc_cosine(steering[COMMAND_COSINE][lane]);
        }
    }
    if (aligning > 0)
        EACH_LANE {
            double velocity = feature[VELOCITY][lane];
            double limit = c->alignment_first_limit * (velocity >= c->alignment_limit_velocity)
                + c->alignment_last_limit * (velocity < c->alignment_limit_velocity);
            double sign = 1.0 - 2.0 * (sight[DOWNRANGE_ANGLE][lane] < 0.0);
            double angle = arctangent(sign * sight[CROSSRANGE_ANGLE][lane], sign * sight[DOWNRANGE_ANGLE][lane]);
            double command = -c->alignment_gain * angle;
            command = smaller(larger(command, -limit), limit);
            double cosine = sine_cosine(command).cosine;
            int aligned = steering[ALIGNING][lane] > 0.0;
            steering[COMMAND][lane] = aligned ? command : steering[COMMAND][lane];
            steering[COMMAND_COSINE][lane] = aligned ? cosine : steering[COMMAND_COSINE][lane];
        }
}

static void limit_rate(const flight_t *f, int64_t cycle, double steering[][LANES], double *largest_bank, double *largest_change) {
    const settings_t *c = f->c;
    EACH_LANE {
        double command = steering[COMMAND][lane], before = steering[FLOWN_BANK][lane], most = c->largest_bank_change;
        double bank = smaller(larger(command, before - most), before + most);
        bank = cycle == 0 ? command : bank;
        double change = cycle > 0 ? fabs(bank - before) : 0.0;
        steering[FLOWN_BANK][lane] = bank, steering[FLOWN_CHANGE][lane] = change;
        int flying = steering[FLYING][lane] > 0.0;
        largest_bank[lane] = flying ? larger(largest_bank[lane], fabs(bank)) : largest_bank[lane];
        largest_change[lane] = flying ? larger(largest_change[lane], change) : largest_change[lane];
    }
}

static void sample_factors(const flight_t *f, uint64_t first_trial, double *negative) {
    const problem_t *p = f->p;
    row_t normals[4], process;
    EACH_LANE process[lane] = 0.0, negative[lane] = 0.0;
    for (int64_t number = 0; number < p->nodes; number++) {
        if (number % 4 == 0) fill_normals(p->seed, p->stream, first_trial, number / 4, normals);
        int64_t node = p->nodes - 1 - number;
        double keep = number > 0 ? exponential(p->log_retention[node]) : 0.0, fresh = sqrt(1.0 - keep * keep);
        EACH_LANE {
            process[lane] = keep * process[lane] + fresh * normals[number % 4][lane];
            double density = 1.0 + p->deviation[node] * process[lane];
            negative[lane] += density < 0.0;
            f->factor[node][lane] = larger(density, 0.0);
        }
    }
}

/* history: (cycles, 7, trials), observed: (cycles, 2, trials), largest: (2, trials), length: (trials,), final: (9, trials);
 * factors: scratch, (nodes, LANES). */
void fly(const problem_t *p, double *history, double *observed, double *largest, int64_t *length, double *final, double *factors) {
    const settings_t *c = p->settings;
    double step = c->period / p->substeps;
    for (int64_t offset = 0; offset < p->trials; offset += LANES) {
        flight_t flight = {.p = p, .c = c, .factor = (double (*)[LANES])factors}, *f = &flight;
        row_t state[STATES], before[STATES], ended[STATES], feature[FEATURES], sight[SIGHTED], steering[STEERED], last[FINAL];
        row_t most[2];
        sample_factors(f, p->first_trial + offset, last[NEGATIVE_DENSITIES]);
        for (int row = 0; row < STATES; row++) memcpy(state[row], p->entry_state + row * p->trials + offset, sizeof(row_t));
        memcpy(f->aero[DRAG_FACTOR], p->drag_factor + offset, sizeof(row_t));
        memcpy(f->aero[LIFT_FACTOR], p->lift_factor + offset, sizeof(row_t));
        for (int row = 0; row < 2; row++) memcpy(most[row], largest + row * p->trials + offset, sizeof(row_t));
        memset(steering, 0, sizeof steering);
        EACH_LANE {
            steering[DIRECTION][lane] = c->initial_direction, steering[FLYING][lane] = 1.0;
            last[REVERSALS][lane] = 0.0, last[END_TIME][lane] = p->end_time, length[offset + lane] = p->cycles;
        }
        int remaining = LANES;
        for (int64_t flown = 0;; flown++) {
            int over = remaining == 0 || flown == p->cycles * p->substeps;
            int64_t cycle = flown / p->substeps, substep = flown % p->substeps;
            double time = cycle * c->period;
            if (over)
                for (int row = 0; row < STATES; row++)
                    EACH_LANE state[row][lane] = steering[FLYING][lane] > 0.0 ? state[row][lane] : ended[row][lane];
            if (over || substep == 0) observe(f, state, feature, sight);
            if (over) break;
            if (substep == 0) {
                command_cosine(f, cycle, feature, steering);
                command_bank(f, time, feature, sight, steering, last[REVERSALS]);
                limit_rate(f, cycle, steering, most[0], most[1]);
                EACH_LANE {
                    pair_t bank = sine_cosine(steering[FLOWN_BANK][lane]);
                    f->aero[SINE][lane] = bank.sine, f->aero[COSINE][lane] = bank.cosine;
                }
                double *stored = history + cycle * HISTORY * p->trials + offset, *seen = observed + cycle * 2 * p->trials + offset;
                EACH_LANE stored[lane] = feature[0][lane] - c->planet_radius;
                for (int j = 1; j < 5; j++) memcpy(stored + j * p->trials, feature[j], sizeof(row_t));
                memcpy(stored + CROSSRANGE * p->trials, sight[SIGHTED_CROSSRANGE], sizeof(row_t));
                memcpy(stored + BANK_COSINE * p->trials, steering[COMMAND_COSINE], sizeof(row_t));
                memcpy(seen, steering[FLOWN_BANK], sizeof(row_t));
                memcpy(seen + p->trials, steering[FLOWN_CHANGE], sizeof(row_t));
                EACH_LANE steering[FLOWN_CHANGE][lane] = 0.0;
            }
            memcpy(before, state, sizeof state);
#define DRIFT(number, x, out) drift(f, x, out)
            RUNGE_KUTTA(STATES, step, state, DRIFT);
            EACH_LANE {
                if (!(state[SPEED][lane] <= c->end_velocity && steering[FLYING][lane] > 0.0)) continue;
                double start[STATES], end[STATES];
                for (int row = 0; row < STATES; row++) start[row] = before[row][lane], end[row] = state[row][lane];
                double part = to_trigger(f, step, lane, start, end);
                last[END_TIME][lane] = time + substep * step + part;
                for (int row = 0; row < STATES; row++) ended[row][lane] = end[row];
                length[offset + lane] = cycle + 1;
                steering[FLYING][lane] = 0.0;
                remaining--;
            }
        }
        EACH_LANE last[0][lane] = feature[0][lane] - c->planet_radius;
        for (int j = 1; j < 5; j++) memcpy(last[j], feature[j], sizeof(row_t));
        memcpy(last[CROSSRANGE], sight[SIGHTED_CROSSRANGE], sizeof(row_t));
        for (int row = 0; row < FINAL; row++) memcpy(final + row * p->trials + offset, last[row], sizeof(row_t));
        for (int row = 0; row < 2; row++) memcpy(largest + row * p->trials + offset, most[row], sizeof(row_t));
    }
}
