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
WEAKENED = 17  # how far sliding has weakened friction: 0 static, 1 kinetic
TENSION = 18  # [N]
FORCE = 19  # normal force on the fingertip [N]
FRESH = 20  # 1 where the last step was of another length: differences tell nothing
SQUEEZED = 21  # compression of the fingertip [m]
SQUEEZED_DIFFERENCE = 22  # and how it changed in the last step [m]
VELOCITIES = 23  # of the modes [rad/s]
VELOCITY_DIFFERENCES = 26  # and how they changed in the last step [rad/s]
STATE_ROWS = 29

CLEARANCE = 29  # drop at which the tip touches the top [m]
OFFSET = 30  # added to guide * SCALE + reach: the tip's coordinate on the surface [m]
SCALE = 31  # true over commanded motion of the guide
TENDON_ZERO = 32  # added to the tendon's displacement [m]
FRICTION = 33  # static coefficient of the fingertip
FINGER_FACTOR = 34  # stiffness over the described one
OBJECT_FACTOR = 35
TRIAL_ROWS = 36

NEW_MODES = 36
BASES = 39  # what the rates of change are counted from [rad]
RATE = 42  # 1 / time since the bases [1/s]
CREEP_MOMENTS = 43
REST = 46  # force that an object's relaxed branches take from it [N]
MATERIAL = 47  # its stiffness over the step [N/m]
REACH = 48  # tip's coordinate without what is pulled from under it [m]
CELL = 49  # the same on the surface's grid
HEIGHT = 50
INCLINE = 51
BEND = 52
NEW_FORCE = 53
FORCE_SLOPE = 54
NEW_PRESSED = 55
OPEN = 56  # 1 while the trial's step is not solved
NEW_TENSION = 57
NEW_TIP = 58
NEW_TENDON = 59
SQUEEZED_BASE = 60  # what the tip's rate of change is counted from [m]
ACTIVE = 61  # 1 while the trial takes part in the step
SOLVED = 62  # 1 once it has solved it
SWING_BASES = 63  # what accelerations are counted from [rad/s^2]
END_FORCE = 66  # normal force at the end of the step [N]
LINE = 67
ROWS = LINE + 19

# Columns of the coefficients of a step: 1 / its length, then three numbers
# (see compute_relaxation) for the creep, three branches, and the sensor's low pass.
RATE_COLUMN = 0
CREEP_COLUMN = 1
BRANCH_COLUMN = 4
SENSOR_COLUMN = 13
HEALING_COLUMN = 16  # share of friction's weakening that outlasts the step
COLUMNS = 17

# Inputs at the end of a step.
TENDON_INPUT = 0  # displacement of the tendon [m]
GUIDE_INPUT = 1  # position of the guide [m]
SHAPE_INPUT = 2  # how far the shape of what is touched has moved [m]
MATERIAL_INPUT = 3  # and its material at the place of contact [m]
PRESENT_INPUT = 4  # 1 where the guide has it under the tip, else 0
INPUTS = 5

MAX_BRANCHES = 3
