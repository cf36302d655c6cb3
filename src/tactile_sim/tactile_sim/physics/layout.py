# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rows of a trial's quantities in a solver's block, shape (ROWS, trials).

The first STATE_ROWS are what a trial remembers from one step to the next; then follow
what makes it differ from others; the rest is scratch of one step.
"""

from __future__ import annotations

MODES = 0  # q0, q1, q2 [rad]
CREEP = 3  # their relaxed parts [rad]
DIFFERENCES = 6  # how far they went in the last step [rad]
TIP_SLIDER = 9  # where the fingertip stuck on the material [m]
TENDON_SLIDER = 10  # bend at which the tendon stuck in the finger [rad]
BRANCHES = 11  # relaxed effective compression of an object's branches [m]
PRESSED = 14  # its effective compression [m]
SENSED = 15  # the sensor's low-passed tension [N]
SENSOR_INPUT = 16  # what enters its low pass [N]
TENSION = 17  # [N]
FORCE = 18  # normal force on the fingertip [N]
FRESH = 19  # 1 where the last step was of another length: differences tell nothing
SQUEEZED = 20  # compression of the fingertip [m]
SQUEEZED_DIFFERENCE = 21  # and how it changed in the last step [m]
VELOCITIES = 22  # of the modes [rad/s]
VELOCITY_DIFFERENCES = 25  # and how they changed in the last step [rad/s]
STATE_ROWS = 28

CLEARANCE = 28  # drop at which the tip touches the top [m]
OFFSET = 29  # added to guide * SCALE + reach: the tip's coordinate on the surface [m]
SCALE = 30  # true over commanded motion of the guide
TENDON_ZERO = 31  # added to the tendon's displacement [m]
FRICTION = 32  # coefficient of the fingertip
FINGER_FACTOR = 33  # stiffness over the described one
OBJECT_FACTOR = 34
TRIAL_ROWS = 35

NEW_MODES = 35
BASES = 38  # what the rates of change are counted from [rad]
RATE = 41  # 1 / time since the bases [1/s]
CREEP_MOMENTS = 42
REST = 45  # force that an object's relaxed branches take from it [N]
MATERIAL = 46  # its stiffness over the step [N/m]
REACH = 47  # tip's coordinate on the surface [m]
CELL = 48  # the same on the surface's grid
HEIGHT = 49
INCLINE = 50
BEND = 51
NEW_FORCE = 52
FORCE_SLOPE = 53
NEW_PRESSED = 54
OPEN = 55  # 1 while the trial's step is not solved
NEW_TENSION = 56
NEW_TIP = 57
NEW_TENDON = 58
SQUEEZED_BASE = 59  # what the tip's rate of change is counted from [m]
ACTIVE = 60  # 1 while the trial takes part in the step
SOLVED = 61  # 1 once it has solved it
SWING_BASES = 62  # what accelerations are counted from [rad/s^2]
END_FORCE = 65  # normal force at the end of the step [N]
LINE = 66
ROWS = LINE + 19

# Columns of the coefficients of a step: 1 / its length, then three numbers
# (see compute_relaxation) for the creep, three branches, and the sensor's low pass.
RATE_COLUMN = 0
CREEP_COLUMN = 1
BRANCH_COLUMN = 4
SENSOR_COLUMN = 13
COLUMNS = 16

# Inputs at the end of a step.
TENDON_INPUT = 0  # displacement of the tendon [m]
GUIDE_INPUT = 1  # position of the guide [m]
PRESENT_INPUT = 2  # 1 where the guide has it under the tip, else 0
INPUTS = 3

MAX_BRANCHES = 3
