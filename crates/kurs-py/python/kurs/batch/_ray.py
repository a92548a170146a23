"""Ray as an executor: what `run` and `monte_carlo` need of one."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from importlib import import_module
from typing import Any


class RayExecutor(Executor):
    """Tasks of `ray.remote` behind the interface of `concurrent.futures`; `options` are those of a remote function.

    Ray must have been initialised: `ray.init(num_cpus=2)`.
    """

    def __init__(self, **options: Any) -> None:
        self._ray: Any = import_module("ray")
        self._options = options

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Begins a task."""
        remote = self._ray.remote(fn)
        task = (remote.options(**self._options) if self._options else remote).remote(*args, **kwargs)
        future: Future[Any] = task.future()
        return future
