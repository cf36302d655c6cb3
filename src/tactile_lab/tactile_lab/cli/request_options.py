# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The options of a command, made of the dataclass that they fill."""

from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, MISSING
import functools
import inspect
from typing import Annotated, Any, get_origin, get_type_hints


def spread(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options that its parameters of a dataclass' type state.

    An option is a field declared as ``Annotated``: those of the class, then those that it
    inherits. A field that is a dataclass stands for the options of its own. Other fields keep
    their defaults.
    """
    signature = inspect.signature(command)
    stated = signature.parameters.values()
    requests = {p.name: p.annotation for p in stated if is_dataclass(p.annotation)}

    @functools.wraps(command)
    def run(**options: Any) -> None:
        made = {name: _fill(request, options) for name, request in requests.items()}
        command(**made, **options)

    parameters: list[inspect.Parameter] = []
    for parameter in stated:
        if parameter.name in requests:
            parameters += _list_options(parameter.annotation)
        else:
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
    # Typer reads both.
    vars(run)['__signature__'] = signature.replace(parameters=parameters)
    run.__annotations__ = {p.name: p.annotation for p in parameters}
    return run


def _list_options(request: Any) -> Iterator[inspect.Parameter]:
    defaults = {f.name: f.default for f in fields(request) if f.default is not MISSING}
    for name, kind in _option_types(request):
        if is_dataclass(kind):
            yield from _list_options(kind)
        else:
            default = defaults.get(name, inspect.Parameter.empty)
            yield inspect.Parameter(
                name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind
            )


def _fill(request: Any, options: dict[str, Any]) -> Any:
    """Make a request of those options that are its; take them out."""
    return request(
        **{
            name: _fill(kind, options) if is_dataclass(kind) else options.pop(name)
            for name, kind in _option_types(request)
        }
    )


def _option_types(request: Any) -> list[tuple[str, Any]]:
    types = get_type_hints(request, include_extras=True)
    names = dict.fromkeys(n for kind in request.__mro__ for n in inspect.get_annotations(kind))
    return [
        (n, types[n]) for n in names if get_origin(types[n]) is Annotated or is_dataclass(types[n])
    ]
