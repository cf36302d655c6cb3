# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Indices of the rows and columns in the solver's arrays.

A block of trials is an array of shape (ROWS, trials). Its first STATE_ROWS rows are the state of
each trial between two time steps. The next rows, up to TRIAL_ROWS, are parameters of each trial.
The remaining rows are temporary values in one time step. q0, q1 and q2 are the modes of the
finger; see `equations`.
"""

from __future__ import annotations

MODES = 0  # q0, q1, q2 [rad]
CREEP = 3  # parts of q0, q1, q2 to which the finger's creeping branch has relaxed [rad]
DIFFERENCES = 6  # changes of q0, q1, q2 in the last step [rad]
TIP_SLIDER = 9  # coordinate on the surface where the fingertip last stuck by friction [m]
TENDON_SLIDER = 10  # bend of the finger at which the tendon last stuck by friction [rad]
BRANCHES = 11  # effective compression to which each branch of the object has relaxed [m]
PRESSED = 14  # effective compression of the object [m]
SENSED = 15  # output of the load cell's low-pass filter [N]
SENSOR_INPUT = 16  # input of the load cell's low-pass filter [N]
TENSION = 17  # tension of the tendon [N]
FORCE = 18  # normal force on the fingertip [N]
FRESH = 19  # 1 if the differences are invalid, because the last step had another length
SQUEEZED = 20  # compression of the fingertip [m]
SQUEEZED_DIFFERENCE = 21  # change of the compression of the fingertip in the last step [m]
VELOCITIES = 22  # rates of change of q0, q1, q2 [rad/s]
VELOCITY_DIFFERENCES = 25  # changes of the rates of q0, q1, q2 in the last step [rad/s]
STATE_ROWS = 28

CLEARANCE = 28  # drop of the tip at which it touches the top of the plate or object [m]
OFFSET = 29  # coordinate of the tip on the surface, minus (guide * SCALE + reach of the tip) [m]
SCALE = 30  # ratio of true to commanded motion of the guide
TENDON_ZERO = 31  # error of the tendon's zero position, added to its displacement [m]
FRICTION = 32  # friction coefficient of the fingertip
FINGER_FACTOR = 33  # stiffness of the finger, relative to its description
OBJECT_FACTOR = 34  # stiffness of the object, relative to its description
TRIAL_ROWS = 35

NEW_MODES = 35
BASES = 38  # bases of q0, q1, q2 in the formula of a rate of change, (q - base) * RATE [rad]
RATE = 41  # factor in the formula of a rate of change [1/s]
CREEP_MOMENTS = 42
REST = 45  # decrease of the object's force because its branches have relaxed [N]
MATERIAL = 46  # stiffness of the object in this time step [N/m]
REACH = 47  # coordinate of the tip on the surface [m]
CELL = 48  # coordinate of the tip on the surface, in cells of the surface's grid
HEIGHT = 49
INCLINE = 50
BEND = 51
NEW_FORCE = 52
FORCE_SLOPE = 53
NEW_PRESSED = 54
OPEN = 55  # 1 while the iterations have not yet found the solution of the trial
NEW_TENSION = 56
NEW_TIP = 57
NEW_TENDON = 58
SQUEEZED_BASE = 59  # base of the fingertip's compression in the formula of its rate [m]
ACTIVE = 60  # 1 if the present step must be solved for the trial
SOLVED = 61  # 1 if the present step has been solved for the trial
SWING_BASES = 62  # bases in the formula of accelerations, q * RATE^2 - swing base [rad/s^2]
END_FORCE = 65  # normal force at the end of the step [N]
LINE = 66
ROWS = LINE + 19

# Columns of the coefficients for one step length. The first column is 1 / length. The next ones
# are results of `steps.compute_relaxation`, three for each of these: the creep of the finger, the
# three branches of the object, and the low-pass filter of the load cell.
RATE_COLUMN = 0
CREEP_COLUMN = 1
BRANCH_COLUMN = 4
SENSOR_COLUMN = 13
COLUMNS = 16

# Columns of the inputs of the solver, which are the values at the end of each time step.
TENDON_INPUT = 0  # displacement of the tendon [m]
GUIDE_INPUT = 1  # position of the guide [m]
PRESENT_INPUT = 2  # 1 if the plate or object is under the tip at the guide's position, else 0
INPUTS = 3

MAX_BRANCHES = 3
