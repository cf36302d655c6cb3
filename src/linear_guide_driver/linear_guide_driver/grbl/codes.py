# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What Grbl 1.1's error, alarm and state codes mean."""

STATES = frozenset(
    {'Idle', 'Run', 'Hold', 'Jog', 'Alarm', 'Door', 'Check', 'Home', 'Sleep', 'Tool'}
)
"""Machine states of a status report; Tool is grblHAL's."""

ERRORS = {
    1: 'a word has no letter',
    2: 'a number is missing or malformed',
    3: 'unknown $ command',
    4: 'the value is negative',
    5: 'homing is switched off',
    6: 'the step pulse is too short',
    7: 'the EEPROM could not be read; defaults are in use',
    8: 'the command needs an idle controller',
    9: 'G-code is locked by an alarm or a jog',
    10: 'soft limits need homing switched on',
    11: 'the line is too long',
    12: 'the step rate is too high',
    13: 'the safety door is open',
    14: 'the line is too long to be stored',
    15: 'the jog leaves the travel',
    16: 'malformed jog',
    17: 'laser mode needs PWM output',
    20: 'unknown or unsupported word',
    21: 'two words of one modal group',
    22: 'no feed rate was given',
    23: 'a word needs an integer value',
    24: 'two commands want the axis words',
    25: 'a word is repeated',
    26: 'axis words are missing',
    27: 'the line number is out of range',
    28: 'a required word is missing',
    29: 'the coordinate system is not supported',
    30: 'G53 needs G0 or G1',
    31: 'axis words without a command that uses them',
    32: 'an arc has no word in its plane',
    33: 'the target is not valid',
    34: "the arc's radius is not valid",
    35: "an arc's offset is missing",
    36: 'words are left over',
    37: 'the tool length offset is on another axis',
    38: 'the tool number is too large',
}

ALARMS = {
    1: 'hard limit: a limit switch was hit',
    2: 'soft limit: the target leaves the travel',
    3: 'reset while moving: the position is lost',
    4: 'the probe was in the wrong state at the start',
    5: 'the probe made no contact',
    6: 'homing was ended by a reset',
    7: 'the safety door opened during homing',
    8: 'homing did not clear the limit switch',
    9: 'homing did not find the limit switch',
    10: 'homing did not find the second limit switch of a dual axis',
}


def describe_error(code: int) -> str:
    """Return ``error:N (meaning)``."""
    return f'error:{code} ({ERRORS.get(code, "not a code of Grbl 1.1")})'


def describe_alarm(code: int) -> str:
    """Return ``ALARM:N (meaning)``."""
    return f'ALARM:{code} ({ALARMS.get(code, "not a code of Grbl 1.1")})'
