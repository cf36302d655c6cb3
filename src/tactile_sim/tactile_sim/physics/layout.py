# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rows of a trial's quantities in a solver's block, shape (ROWS, trials).

The first STATE_ROWS are the state of a trial between two steps. The next rows are parameters
that differ between trials. The remaining rows are temporary values of one step.
"""

from __future__ import annotations

MODES = 0  # q0, q1, q2 [rad]
CREEP = 3  # their relaxed parts [rad]
DIFFERENCES = 6  # their changes in the last step [rad]
TIP_SLIDER = 9  # position on the material where the fingertip stuck [m]
TENDON_SLIDER = 10  # bend at which the tendon stuck in the finger [rad]
BRANCHES = 11  # relaxed effective compression of an object's branches [m]
PRESSED = 14  # its effective compression [m]
SENSED = 15  # the sensor's low-passed tension [N]
SENSOR_INPUT = 16  # input of the sensor's low pass [N]
TENSION = 17  # [N]
FORCE = 18  # normal force on the fingertip [N]
FRESH = 19  # 1 if the last step had another length, so that differences are invalid
SQUEEZED = 20  # compression of the fingertip [m]
SQUEEZED_DIFFERENCE = 21  # its change in the last step [m]
VELOCITIES = 22  # of the modes [rad/s]
VELOCITY_DIFFERENCES = 25  # their changes in the last step [rad/s]
STATE_ROWS = 28

CLEARANCE = 28  # drop at which the tip touches the top [m]
OFFSET = 29  # added to guide * SCALE + reach: coordinate of the tip on the surface [m]
SCALE = 30  # ratio of true to commanded motion of the guide
TENDON_ZERO = 31  # added to the tendon's displacement [m]
FRICTION = 32  # friction coefficient of the fingertip
FINGER_FACTOR = 33  # ratio of stiffness to the described one
OBJECT_FACTOR = 34
TRIAL_ROWS = 35

NEW_MODES = 35
BASES = 38  # reference of the rates of change [rad]
RATE = 41  # 1 / time since the bases [1/s]
CREEP_MOMENTS = 42
REST = 45  # force that is missing due to the object's relaxed branches [N]
MATERIAL = 46  # its stiffness over the step [N/m]
REACH = 47  # coordinate of the tip on the surface [m]
CELL = 48  # the same on the surface's grid
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
SQUEEZED_BASE = 59  # reference of the tip's rate of change [m]
ACTIVE = 60  # 1 while the trial takes part in the step
SOLVED = 61  # 1 once the trial has solved the step
SWING_BASES = 62  # reference of the accelerations [rad/s^2]
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
