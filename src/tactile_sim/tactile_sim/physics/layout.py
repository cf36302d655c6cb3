# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rows of a trial's quantities in a solver's block, shape (ROWS, trials).

The first STATE_ROWS are the state of a trial between two steps. The next rows are parameters
that differ between trials. The remaining rows are temporary values of one step.
"""

from __future__ import annotations

MODES = 0  # q0, q1, q2 [rad]
CREEP = 3  # relaxed parts of q0, q1, q2 [rad]
DIFFERENCES = 6  # changes of q0, q1, q2 in the last step [rad]
TIP_SLIDER = 9  # position on the material where the fingertip stuck [m]
TENDON_SLIDER = 10  # bend at which the tendon stuck in the finger [rad]
BRANCHES = 11  # relaxed effective compression of the object's branches [m]
PRESSED = 14  # effective compression of the object [m]
SENSED = 15  # the sensor's low-passed tension [N]
SENSOR_INPUT = 16  # input of the sensor's low pass [N]
TENSION = 17  # tension of the tendon [N]
FORCE = 18  # normal force on the fingertip [N]
FRESH = 19  # 1 if the last step had another length, so that differences are invalid
SQUEEZED = 20  # compression of the fingertip [m]
SQUEEZED_DIFFERENCE = 21  # change of the compression of the fingertip in the last step [m]
VELOCITIES = 22  # rates of change of q0, q1, q2 [rad/s]
VELOCITY_DIFFERENCES = 25  # changes of these rates in the last step [rad/s]
STATE_ROWS = 28

CLEARANCE = 28  # drop at which the tip touches the top [m]
OFFSET = 29  # coordinate of the tip on the surface, minus guide * SCALE + reach [m]
SCALE = 30  # ratio of true to commanded motion of the guide
TENDON_ZERO = 31  # error of the zero, which is added to the tendon's displacement [m]
FRICTION = 32  # friction coefficient of the fingertip
FINGER_FACTOR = 33  # stiffness of the finger, relative to its description
OBJECT_FACTOR = 34  # stiffness of the object, relative to its description
TRIAL_ROWS = 35

NEW_MODES = 35
BASES = 38  # values of q0, q1, q2 from which their rates of change are computed [rad]
RATE = 41  # 1 / time since the bases [1/s]
CREEP_MOMENTS = 42
REST = 45  # force that is missing due to the object's relaxed branches [N]
MATERIAL = 46  # stiffness of the object over the step [N/m]
REACH = 47  # coordinate of the tip on the surface [m]
CELL = 48  # coordinate of the tip on the grid of the surface [cells]
HEIGHT = 49
INCLINE = 50
BEND = 51
NEW_FORCE = 52
FORCE_SLOPE = 53
NEW_PRESSED = 54
OPEN = 55  # 1 while the step of the trial is not solved
NEW_TENSION = 56
NEW_TIP = 57
NEW_TENDON = 58
SQUEEZED_BASE = 59  # compression of the fingertip from which its rate of change is computed [m]
ACTIVE = 60  # 1 while the trial takes part in the step
SOLVED = 61  # 1 once the trial has solved the step
SWING_BASES = 62  # values from which the accelerations of the modes are computed [rad/s^2]
END_FORCE = 65  # normal force at the end of the step [N]
LINE = 66
ROWS = LINE + 19

# Columns of the coefficients of a step: 1 / its length, then three numbers each
# (see compute_relaxation) for the creep, three branches, and the sensor's low pass.
RATE_COLUMN = 0
CREEP_COLUMN = 1
BRANCH_COLUMN = 4
SENSOR_COLUMN = 13
COLUMNS = 16

# Inputs at the end of a step.
TENDON_INPUT = 0  # displacement of the tendon [m]
GUIDE_INPUT = 1  # position of the guide [m]
PRESENT_INPUT = 2  # 1 if plate or object is under the tip at this guide position, else 0
INPUTS = 3

MAX_BRANCHES = 3
