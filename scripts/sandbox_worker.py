"""Where a submission's functions run for `make grades`.

A server imports the packages once, then forks a process for each exercise. That process defines the submission's
functions, and answers the grader over a pipe: the check itself, what it knows and its verdict never come here. Limits
hold on its time, its memory and its files. Where bubblewrap is installed, `make_grades.py` starts the server in it:
without a network, with nothing to write but a temporary folder, and without the checks and the solutions.
"""

import ast
import builtins
import contextlib
import importlib
import importlib.util
import io
import json
import linecache
import numbers
import os
import pickle
import resource
import signal
import socket
import sys
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import torch

CHECKS = "clothlab.checks"
SETTABLE = ("z_ref", "exploring")  # what exercises ask to set on what a check lends to an answer
FILE_BYTES = 10_000_000  # a file that an answer may write
KEPT = (ast.Import, ast.ImportFrom, ast.FunctionDef, ast.ClassDef, ast.Assign)


def load_alone(name: str) -> Any:
    """The module `clothlab.checks.NAME`, without those that know the answers."""
    path = Path(importlib.import_module("clothlab").__file__ or "").parent / "checks" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"worker{name}", path)
    module = importlib.util.module_from_spec(spec)  # type: ignore[arg-type]
    spec.loader.exec_module(module)  # type: ignore[union-attr]
    return module


class Worker:
    """Defines a submission's functions, and calls them when it is asked to.

    Args:
        connection: to the grader. What comes from there is pickled; what goes there is JSON, which can do nothing.
        common: `clothlab.checks._check`.
    """

    def __init__(self, connection: Connection, common: Any):
        self.connection, self.common = connection, common
        self.handed: list[Any] = []  # functions that the grader may call, by their places here

    def run(self, sources: list[str], name: str) -> None:
        """Define what the sources define, then answer until the grader hangs up."""
        found, problem = defined(sources, name)
        self.send("ready" if found is not None else "missing", problem)
        self.handed.append(found)
        while True:
            place, args, kwargs = self.receive()
            try:
                self.send("result", self.encode(self.call(self.handed[place], args, kwargs)))
            except InPlace as argument:
                self.send("changed", str(argument))
            except Exception as error:
                trace = error.__traceback__ and error.__traceback__.tb_next  # from `call` on
                self.send("error", self.common._described(error.with_traceback(trace)))

    def call(self, function: Any, args: tuple, kwargs: dict) -> Any:
        """What the function returns.

        Raises:
            InPlace: it has changed an argument.
        """
        given = self.common._data(function, args, kwargs)
        before = {name: pickle.dumps(value) for name, value in given.items()}
        found = function(*args, **kwargs)
        for name, value in given.items():
            if not self.common._same(value, pickle.loads(before[name])):
                raise InPlace(name)
        return found

    def encode(self, value: Any) -> Any:
        """A value as JSON can hold it: numbers, arrays, lists and tuples of them, functions; words for all else."""
        if isinstance(value, torch.Tensor):
            value = value.detach().cpu().numpy()
        if isinstance(value, np.generic):
            value = value.item()
        if value is None or isinstance(value, bool | int | float | str):
            return value
        if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
            return {"array": value.ravel().tolist(), "shape": value.shape, "dtype": value.dtype.name}
        if isinstance(value, numbers.Real):
            return float(value)
        if isinstance(value, list | tuple):
            return {type(value).__name__: [self.encode(part) for part in value]}
        if isinstance(value, Lent):
            return {"lent": value.__dict__["_place"]}
        if callable(value):
            self.handed.append(value)
            return {"function": len(self.handed) - 1}
        return {"odd": self.common._shown(value)}

    def send(self, *message: Any) -> None:
        """Say something to the grader."""
        self.connection.send_bytes(json.dumps(message).encode())

    def receive(self) -> Any:
        """What the grader says."""
        reader = pickle.Unpickler(io.BytesIO(self.connection.recv_bytes()))
        reader.persistent_load = lambda place: Lent(self, place)  # type: ignore[method-assign]
        return reader.load()

    def ask(self, *message: Any) -> Any:
        """Ask the grader for something that only it has; meanwhile it may ask for nothing itself."""
        self.send(*message)
        kind, value = self.receive()
        if kind == "raised":
            name, words = value
            error = getattr(builtins, name, RuntimeError)
            raise (error if issubclass(error, Exception) else RuntimeError)(words)
        return value


class InPlace(Exception):
    """An argument was changed by a function that it was given to."""


class Lent:
    """Stands for a function of the check's, which is called where the check is."""

    def __init__(self, worker: Worker, place: int):
        self.__dict__.update(_worker=worker, _place=place)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        worker = self.__dict__["_worker"]
        values = {name: worker.encode(value) for name, value in kwargs.items()}
        return worker.ask("call", self.__dict__["_place"], [worker.encode(value) for value in args], values)

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in SETTABLE:
            raise AttributeError(f"{name} can't be set here")
        self.__dict__[name] = value
        worker = self.__dict__["_worker"]
        worker.ask("set", self.__dict__["_place"], name, worker.encode(value))


def defined(sources: list[str], name: str) -> tuple[Any, str]:
    """The function of this name after the sources' imports, functions, classes and values; or why there is none.

    Of values, those that it needs are computed, by name and through other functions. Nothing else is run: a
    submission's own calls, checks and outputs count for nothing.
    """
    space: dict[str, Any] = {"__name__": "submission"}
    problem = f"there is no function {name}"
    cells: list[tuple[str, list[ast.stmt]]] = []
    for number, source in enumerate(sources):
        file = f"cell-{number}"
        linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
        try:
            cells.append((file, [piece for node in ast.parse(source, file).body for piece in _pieces(node)]))
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            if f"def {name}" in source:
                problem = f"the cell of {name} is not Python: {type(error).__name__}: {str(error).splitlines()[0]}"
    needed = _needed(name, [node for _, nodes in cells for node in nodes])
    for file, nodes in cells:
        for node in nodes:
            if isinstance(node, ast.Assign) and not needed & _defines(node):
                continue
            try:
                exec(compile(ast.Module([node], []), file, "exec"), space)
            except Exception as error:
                if getattr(node, "name", None) == name:
                    problem = f"{name} could not be defined: {type(error).__name__}: {error}"
    found = space.get(name)
    return (found, "") if callable(found) else (None, problem)


def _pieces(node: ast.stmt) -> list[ast.stmt]:
    """What of a statement is run: imports one by one, since one of them may be missing here."""
    if isinstance(node, ast.Import):
        return [ast.copy_location(ast.Import([alias]), node) for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        return [ast.copy_location(ast.ImportFrom(node.module, [each], node.level), node) for each in node.names]
    return [node] if isinstance(node, KEPT) else []


def _defines(node: ast.stmt) -> set[str]:
    """The names that a statement gives a meaning."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return {node.name}
    targets = node.targets if isinstance(node, ast.Assign) else []
    return {each.id for target in targets for each in ast.walk(target) if isinstance(each, ast.Name)}


def _needed(name: str, nodes: list[ast.stmt]) -> set[str]:
    """The names that a function needs, and what these need."""
    needed, new = set[str](), {name}
    while new:
        needed |= new
        parts = [each for node in nodes if new & _defines(node) for each in ast.walk(node)]
        new = {each.id for each in parts if isinstance(each, ast.Name)} - needed
    return needed


def confine(folder: Path, seconds: int, memory: int) -> None:
    """Make a folder this process's home, and limit its time [s], its further memory [bytes] and its files."""
    os.setsid()
    os.chdir(folder)
    os.environ.clear()
    os.environ |= {"HOME": str(folder), "TMPDIR": str(folder), "PATH": "/usr/bin:/bin", "OMP_NUM_THREADS": "1"}
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        os.dup2(nothing, stream)
    space = psutil.Process().memory_info().vms + memory
    limits = {"AS": space, "CPU": seconds, "FSIZE": FILE_BYTES, "CORE": 0, "NOFILE": 64}
    for name, most in limits.items():
        resource.setrlimit(getattr(resource, f"RLIMIT_{name}"), (most, most))
    for name in [each for each in sys.modules if each == CHECKS or each.startswith(f"{CHECKS}.")]:
        del sys.modules[name]
    sys.modules[CHECKS] = None  # type: ignore[assignment]


def main() -> None:
    """Serve requests: start a process that answers over the pipe that is sent along, or end one."""
    server = socket.socket(fileno=int(sys.argv[1]))
    for name in json.loads(sys.argv[2]):
        importlib.import_module(name)
    torch.set_num_threads(1)
    common = load_alone("_check")
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    server.sendall(b"ready")
    while True:
        request, handles, _, _ = socket.recv_fds(server, 4096, 1)
        if not request:
            return
        asked = json.loads(request)
        if "end" in asked:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(asked["end"], signal.SIGKILL)
            continue
        if pid := os.fork():
            os.close(handles[0])
            server.sendall(str(pid).encode())
            continue
        try:
            server.close()
            os.closerange(3, handles[0])
            os.closerange(handles[0] + 1, 256)
            worker = Worker(Connection(handles[0]), common)
            sources, name = worker.receive()
            confine(Path(asked["folder"]), asked["seconds"], asked["memory"])
            worker.run(sources, name)
        finally:
            os._exit(1)


if __name__ == "__main__":
    main()
