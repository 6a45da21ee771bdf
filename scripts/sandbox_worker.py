"""Where the functions of submissions run for `make grades`.

A server imports the packages once, then forks a process for each exercise. That process defines the submission's
functions and answers the grader over a socket: the check, what it knows and its verdict never come here. Limits hold on
its processor time, its memory and its files. Where bubblewrap works, `make_grades.py` starts the server in it.
"""

import ast
import contextlib
import importlib.util
import io
import json
import linecache
import numbers
import os
import pickle
import resource
import shutil
import signal
import socket
import sys
import tempfile
from multiprocessing.connection import Connection
from pathlib import Path
from types import CodeType
from typing import Any

import numpy as np
import psutil
import torch

import clothlab

FILE_BYTES = 10_000_000  # a file that an answer may write


class Worker:
    """Defines a submission's function, and calls it when the grader asks; it answers in JSON, which can do nothing."""

    def __init__(self, connection: Connection, common: Any, name: str):
        self.connection, self.common, self.name = connection, common, name
        self.functions: list[Any] = []  # that the grader may call, by their places here

    def run(self, sources: list[str]) -> None:
        """Define what the sources define, then answer until the grader hangs up."""
        found, problem = defined(sources, self.name)
        if found is None:
            return self.send("failed", problem)
        self.send("result", self.encode(found, self.name))
        while True:
            place, args, kwargs = self.receive()
            try:
                self.send("result", self.encode(self.functions[place](*args, **kwargs), f"the policy of {self.name}"))
            except self.common.CheckFailed as failure:
                self.send("failed", str(failure))

    def encode(self, value: Any, name: str = "") -> Any:
        """Numbers, arrays, lists of them, and functions under a name as JSON can hold them; words for all else."""
        if isinstance(value, torch.Tensor):
            value = value.detach().cpu().numpy()
        if value is None or isinstance(value, bool | int | float | str):
            return value
        if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "biuf":
            return {"array": value.ravel().tolist(), "shape": value.shape} if value.shape else value.item()
        if isinstance(value, numbers.Real):
            return float(value)
        if isinstance(value, list | tuple):
            return [self.encode(part, name) for part in value]
        if isinstance(value, dict):
            return {"dict": [[self.encode(part, name) for part in pair] for pair in value.items()]}
        if isinstance(value, Lent):
            return {"lent": value.__dict__["_place"]}
        if callable(value):
            self.functions.append(self.common._careful(value, name, lambda _, found: found))
            return {"function": len(self.functions) - 1}
        return self.common._shown(value)

    def send(self, *message: Any) -> None:
        self.connection.send_bytes(json.dumps(message).encode())

    def receive(self) -> Any:
        reader = pickle.Unpickler(io.BytesIO(self.connection.recv_bytes()))
        reader.persistent_load = lambda place: Lent(self, place)  # type: ignore[method-assign]
        return reader.load()


class Lent:
    """Stands for a function of the check's, which is called where the check is."""

    def __init__(self, worker: Worker, place: int):
        self.__dict__.update(_worker=worker, _place=place)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        worker, place = self.__dict__["_worker"], self.__dict__["_place"]
        worker.send("call", place, worker.encode(args), {name: worker.encode(kwargs[name]) for name in kwargs})
        return worker.receive()

    def __setattr__(self, name: str, value: Any) -> None:
        worker, place = self.__dict__["_worker"], self.__dict__["_place"]
        worker.send("set", place, name, worker.encode(value))
        self.__dict__[name] = value
        worker.receive()


class Names(dict):
    """The names of a submission. Its values are computed when one is asked for, and not before."""

    def __init__(self):
        super().__init__(__name__="submission")
        self.values_to_compute: dict[str, list[CodeType]] = {}

    def __missing__(self, name: str) -> Any:
        for assignment in self.values_to_compute.pop(name):
            exec(assignment, self)
        return self[name]


def defined(sources: list[str], name: str) -> tuple[Any, str]:
    """The function of this name after the sources' imports, functions, classes and values; or why there is none.

    Nothing else is run: a submission's own calls, checks and outputs count for nothing.
    """
    names, problem = Names(), f"there is no function {name}"
    for number, source in enumerate(sources):
        file = f"cell-{number}"
        linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
        try:
            nodes = pieces(source)
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            if f"def {name}" in source:
                problem = f"the cell of {name} is not Python: {type(error).__name__}: {str(error).splitlines()[0]}"
            continue
        for node in nodes:
            try:
                code = compile(ast.Module([node], []), file, "exec")
                for each in ast.walk(node) if isinstance(node, ast.Assign) else ():
                    target = each.value if isinstance(each, ast.Subscript) else each  # of `a["b"] = 1` it is a
                    if isinstance(target, ast.Name) and isinstance(each.ctx, ast.Store):  # type: ignore[attr-defined]
                        names.values_to_compute.setdefault(target.id, []).append(code)
                if not isinstance(node, ast.Assign):
                    exec(code, names)
            except Exception as error:
                if getattr(node, "name", None) == name:
                    problem = f"{name} could not be defined: {type(error).__name__}: {error}"
    found = names[name] if {name} & {*names, *names.values_to_compute} else None
    return (found, "") if callable(found) else (None, problem)


def pieces(source: str) -> list[ast.stmt]:
    """What of a cell is run: imports one by one, since one of them may be missing here."""
    found: list[ast.stmt] = []
    for node in ast.parse(source).body:
        if isinstance(node, ast.Import | ast.ImportFrom):
            found += [type(node)(**vars(node) | {"names": [each]}) for each in node.names]
        elif isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Assign):
            found.append(node)
    return found


def confine(home: str, seconds: int, megabytes: int) -> None:
    """Make a folder this process's home, and limit its processor time, its further memory and its files."""
    os.setsid()
    os.chdir(home)
    os.environ.clear()
    os.environ |= {"HOME": home, "TMPDIR": home, "PATH": "/usr/bin:/bin", "OMP_NUM_THREADS": "1"}
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        os.dup2(nothing, stream)
    space = psutil.Process().memory_info().vms + megabytes * 1_000_000
    for name, most in {"AS": space, "CPU": seconds, "FSIZE": FILE_BYTES, "CORE": 0, "NOFILE": 64}.items():
        resource.setrlimit(getattr(resource, f"RLIMIT_{name}"), (most, most))


def prepare(imports: str) -> Any:
    """Import all that submissions use, but not the checks, which know the answers; returns what checks share."""
    sys.modules["clothlab.checks"] = None  # type: ignore[assignment]
    for node in pieces(imports):
        with contextlib.suppress(ImportError):
            exec(compile(ast.Module([node], []), "imports", "exec"), {})
    torch.set_num_threads(1)
    path = Path(clothlab.__file__).parent / "checks" / "_check.py"
    spec = importlib.util.spec_from_file_location("_check", path)
    common = importlib.util.module_from_spec(spec)  # type: ignore[arg-type]
    spec.loader.exec_module(common)  # type: ignore[union-attr]
    return common


def main() -> None:
    """Start a process for each socket that comes along, and end the last one with all that it has started."""
    server = socket.socket(fileno=int(sys.argv[1]))
    common = prepare(sys.argv[2])
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    server.sendall(b"ready")
    while (handles := socket.recv_fds(server, 1, 1)[1]) and (home := tempfile.mkdtemp()):
        child = os.fork()
        if not child:
            try:
                server.close()
                connection = Connection(handles[0])
                sources, name, *limits = pickle.loads(connection.recv_bytes())
                confine(home, *limits)
                Worker(connection, common, name).run(sources)
            finally:
                os._exit(1)
        os.close(handles[0])
        server.recv(1)  # the grader is done with it
        with contextlib.suppress(ProcessLookupError):
            os.kill(-1 if os.getpid() == 1 else -child, signal.SIGKILL)  # bubblewrap's first process ends all others
        shutil.rmtree(home, ignore_errors=True)
        server.sendall(b"ended")


if __name__ == "__main__":
    main()
