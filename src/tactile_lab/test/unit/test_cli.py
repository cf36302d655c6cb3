# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command line itself: help, mistyped words, and what Typer makes of the options."""

import dataclasses
import inspect
import os
from pkgutil import iter_modules
from types import UnionType
from typing import get_args

import pytest
import typer
from typer.testing import CliRunner

from tactile_analysis.options import SourceOptions, TrialOptions
from tactile_classifier.datasets.splits import REPETITIONS
from tactile_lab import commands, options, program
from tactile_ros.process import PROFILES, TRANSPORTS


@pytest.mark.parametrize(('before', 'after'), [(None, 'LOCALHOST'), ('SUBNET', 'SUBNET')])
def test_commands_stay_on_this_computer_unless_told_otherwise(monkeypatch, before, after):
    name = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
    for variable in ('RMW_IMPLEMENTATION', name, TRANSPORTS, *PROFILES):
        monkeypatch.setenv(variable, '')  # so that it is restored
        monkeypatch.delenv(variable)
    if before is not None:
        monkeypatch.setenv(name, before)
    monkeypatch.setattr('sys.argv', ['tactile', '--help'])
    with pytest.raises(SystemExit) as ended:
        program.main()
    assert ended.value.code == 0
    assert os.environ[name] == after


@pytest.mark.parametrize('arguments', [['evalute'], ['evaluate', 'x', '--tak', 'texture']])
def test_what_is_mistyped_is_named_once(arguments):
    done = CliRunner().invoke(program.app, arguments)
    assert done.exit_code == 2
    assert done.output.count('Did you mean') <= 1  # Typer 0.9 suggests no command
    assert done.output.count(arguments[-1] if len(arguments) == 1 else '--tak') == 1


def test_help_describes_arguments():
    # Click 8.5 has its own help for arguments, which replaced Typer's.
    for command, text in (('import', 'CSV'), ('show', '(.npz)'), ('repair', 'not closed')):
        found = CliRunner().invoke(program.app, [command, '--help'])
        assert text in ' '.join(found.output.split('Options')[0].split())


def functions_of(name):
    """Return the functions of a command: one, or one per subcommand."""
    found = program.load_function(name)
    if isinstance(found, typer.Typer):
        return [command.callback for command in found.registered_commands]
    return [found]


@pytest.mark.parametrize('name', ['evaluate', 'train', 'classify', 'features', 'import', 'export'])
def test_a_command_on_recordings_has_an_option_for_each_statement_about_them(name):
    parameters = inspect.signature(options.expand(program.load_function(name))).parameters
    kinds = [SourceOptions]
    kinds += [] if name in ('import', 'export') else [TrialOptions]
    for kind in kinds:
        defaults = {field.name: field.default for field in dataclasses.fields(kind)}
        assert defaults == {each: parameters[each].default for each in defaults}


def test_evaluate_divides_into_six_folds_ten_times_by_default():
    parameters = inspect.signature(options.expand(program.load_function('evaluate'))).parameters
    assert (parameters['folds'].default, REPETITIONS) == (6, 10)
    assert parameters['repetitions'].default is None


def test_each_module_of_commands_is_in_the_table():
    modules = {module.name for module in iter_modules(commands.__path__)}
    assert modules == {program.ELSEWHERE.get(name, (name,))[0] for name in program.COMMANDS}


@pytest.mark.parametrize('name', program.COMMANDS)
def test_the_table_has_the_first_line_of_the_help(name):
    found = program.load_function(name)
    text = found.info.help if isinstance(found, typer.Typer) else inspect.getdoc(found)
    assert text.splitlines()[0] == program.COMMANDS[name]


@pytest.mark.parametrize('name', program.COMMANDS)
def test_options_are_declared_as_typer_0_9_reads_them(name):
    """Ubuntu 24.04 has Typer 0.9: no ``X | None``, no annotations that are strings."""
    for function in functions_of(name):
        for parameter in inspect.signature(options.expand(function)).parameters.values():
            stated, *_ = get_args(parameter.annotation) or (parameter.annotation,)
            assert not isinstance(stated, str | UnionType), parameter
