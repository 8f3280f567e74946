"""The descent: the lander of powered_descent from its powered start to the ground, in three dimensions or in the plane.

It is the paper's vehicle with limits of its thrust, held commands, a lag, gusts, navigation errors, and ground a few
metres below the state at which the paper ends. Laws are told, with errors, downrange, crossrange and altitude (m, above
the ground), downrange_velocity, crossrange_velocity and vertical_velocity (m/s, upwards), and mass (kg); they command
thrust_downrange, thrust_crossrange and thrust_vertical (N). Without dispersions across, as in the condition `plane`,
flights stay in the plane.

Resident laws aim at the paper's final state at its final time. From then on they bring the lander to the ground at a
constant speed, wherever it is. `dynamics` has the equations, `onboard` what laws are designed from, `residents` the
laws.
"""
