"""Command lines of benchmarks: parameters of a function as arguments, and `--help`."""

import argparse
import asyncio
import inspect
import sys
from collections.abc import Callable
from typing import Any, NoReturn, get_args


def run_main(main: Callable[..., Any]) -> NoReturn:
    """Call a module's function, or coroutine, with the arguments of the command line.

    They are positional, each of the type of its parameter; those with defaults may be
    left out. It returns the exit status.
    """
    module = inspect.getmodule(main)
    name = (getattr(module, "__spec__", None) or module).name  # type: ignore[union-attr]
    parser = argparse.ArgumentParser(
        prog=f"python -m {name.removesuffix('.__main__')}",
        description=inspect.getdoc(module),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parameters = inspect.signature(main, eval_str=True).parameters.values()
    for parameter in parameters:
        is_needed = parameter.default is parameter.empty
        named: dict[str, Any] = (
            {"nargs": "*"} if parameter.kind is parameter.VAR_POSITIONAL else {}
        )
        if not is_needed:
            named = {"nargs": "?", "default": parameter.default}
            if parameter.default is not None:
                named["help"] = "default: %(default)s"
        kinds = get_args(parameter.annotation) or (parameter.annotation,)
        parser.add_argument(
            parameter.name, metavar=parameter.name.upper(), type=kinds[0], **named
        )
    arguments = vars(parser.parse_args())
    values: list[object] = []
    for parameter in parameters:
        value = arguments[parameter.name]
        is_many = parameter.kind is parameter.VAR_POSITIONAL
        values.extend(value if is_many else [value])
    result = main(*values)
    sys.exit(asyncio.run(result) if inspect.iscoroutine(result) else result)
