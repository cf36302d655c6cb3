# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command line: help, misspelt words and declarations of options."""

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
def test_discovery_is_limited_to_this_computer_unless_the_environment_allows_more(
    monkeypatch, before, after
):
    name = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
    for variable in ('RMW_IMPLEMENTATION', name, TRANSPORTS, *PROFILES):
        monkeypatch.setenv(variable, '')  # so that it is restored after the test
        monkeypatch.delenv(variable)
    if before is not None:
        monkeypatch.setenv(name, before)
    monkeypatch.setattr('sys.argv', ['tactile', '--help'])
    with pytest.raises(SystemExit) as ended:
        program.main()
    assert ended.value.code == 0
    assert os.environ[name] == after


@pytest.mark.parametrize('arguments', [['evalute'], ['evaluate', 'x', '--tak', 'texture']])
def test_misspelt_word_is_named_once(arguments):
    done = CliRunner().invoke(program.app, arguments)
    assert done.exit_code == 2
    assert done.output.count('Did you mean') <= 1  # Typer 0.9 makes no suggestion
    assert done.output.count(arguments[-1] if len(arguments) == 1 else '--tak') == 1


def test_help_describes_arguments():
    # Typer does not display this help if it runs with Click 8.5.
    for command, text in (('import', 'CSV'), ('show', '(.npz)'), ('repair', 'not closed')):
        found = CliRunner().invoke(program.app, [command, '--help'])
        assert text in ' '.join(found.output.split('Options')[0].split())


def functions_of(name):
    """Return the function of a command, or the functions of all of its subcommands."""
    found = program.load_function(name)
    if isinstance(found, typer.Typer):
        return [command.callback for command in found.registered_commands]
    return [found]


@pytest.mark.parametrize('name', ['evaluate', 'train', 'classify', 'features', 'import', 'export'])
def test_commands_on_recordings_have_all_options_that_describe_recordings(name):
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


def test_each_command_module_is_in_the_table():
    modules = {module.name for module in iter_modules(commands.__path__)}
    assert modules == {program.ELSEWHERE.get(name, (name,))[0] for name in program.COMMANDS}


@pytest.mark.parametrize('name', program.COMMANDS)
def test_table_of_commands_has_the_first_line_of_each_docstring(name):
    found = program.load_function(name)
    text = found.info.help if isinstance(found, typer.Typer) else inspect.getdoc(found)
    assert text.splitlines()[0] == program.COMMANDS[name]


@pytest.mark.parametrize('name', program.COMMANDS)
def test_options_are_declared_in_a_way_that_typer_0_9_supports(name):
    """Typer 0.9 of Ubuntu 24.04 supports neither ``X | None`` nor strings as annotations."""
    for function in functions_of(name):
        for parameter in inspect.signature(options.expand(function)).parameters.values():
            stated, *_ = get_args(parameter.annotation) or (parameter.annotation,)
            assert not isinstance(stated, str | UnionType), parameter
