"""A lander whose position and velocity are steered to the ground, mean and covariance, and flown 20,000 times."""

import numpy as np

from marsedl.fly import GainTable, Lander, MultivariateNormal, fly
from marsedl.methods.covariance_steering.closed_form import SteeringProblem, steer
from marsedl.montecarlo.statistics import binomial_interval

STATES = ("downrange", "altitude", "downrange_velocity", "vertical_velocity")
MASS, ISP, GRAVITY, LARGEST, NOISE = 900.0, 220.0, 3.71, 12.0, 0.15  # kg, s, m/s^2 twice, m/s^(3/2)
time = np.linspace(0.0, 30.0, 121)  # s
A, B = np.kron([[0, 1], [0, 0]], np.eye(2)), np.kron([[0], [1]], np.eye(2))
start, spread = [-400.0, 1000.0, 20.0, -50.0], np.diag([30.0, 20.0, 3.0, 2.0]) ** 2
steering = steer(
    SteeringProblem.from_linear_model(
        time,
        (A, B, [0.0, 0.0, 0.0, -GRAVITY]),
        initial_mean=start,
        final_mean=[0.0, 0.0, 0.0, -1.0],
        initial_covariance=spread,
        final_covariance=np.diag([3.0, 1.0, 0.5, 0.3]) ** 2,
        noise_density=NOISE,
    )
)

# The law in newtons, as a table over time: mean thrust, reference and gains.
acceleration = np.linalg.norm(steering.feedforward, axis=1)
mass = MASS * np.exp(-np.cumsum(acceleration) * time[1] / (ISP * 9.80665))
columns = {"time": time} | dict(zip(STATES, steering.mean.T, strict=True))
for row, command in enumerate(("thrust_downrange", "thrust_vertical")):
    columns[command] = mass * steering.feedforward[:, row]
    for place, state in enumerate(STATES):
        columns[f"{command}_per_{state}"] = -mass * steering.gain[:, row, place]

flights = fly(
    Lander(
        largest_thrust=LARGEST * MASS, specific_impulse=ISP, thrust_noise=NOISE * MASS, gravity=GRAVITY, ground=None
    ),
    {STATES: MultivariateNormal(start, spread), "mass": MASS},
    law=GainTable(columns, against="time"),
    end_time=30.0,
    period=0.25,
    substeps=1,
    trials=20_000,
    seed=1,
)
too_much = int((flights.final["max_command"] > LARGEST * MASS).sum())
if __name__ == "__main__":
    print(flights.percentiles([*STATES, "mass"], [1, 50, 99]))
    print(flights.to_pandas()[[*STATES]].std())
    print("more thrust wanted than there is:", too_much, binomial_interval(too_much, flights.trials))
