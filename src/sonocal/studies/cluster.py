"""Workers on Dask distributed: processes of this machine, or an existing cluster."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, Future, InvalidStateError
from contextlib import contextmanager, suppress
from typing import Any

from sonocal.errors import InputError, UnsupportedError
from sonocal.studies.running import Workers, program_version

__all__ = ["existing", "local"]

CONNECT_SECONDS = 20
# A task is done again when its worker dies; only one that has taken so many workers with it is given up.
ALLOWED_DEATHS = 10
KEPT = "results so far are kept"


@contextmanager
def local(count: int, *, kept: str = KEPT) -> Iterator[Workers]:
    """Worker processes on this machine, replaced when they die.

    Args:
        count: how many.
        kept: what is said of the work done when they go away.

    Raises:
        UnsupportedError: Dask is not installed.
    """
    distributed = _distributed()
    import dask

    with (
        dask.config.set({"distributed.scheduler.allowed-failures": ALLOWED_DEATHS}),
        distributed.LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            processes=True,
            dashboard_address="127.0.0.1:0",
            host="127.0.0.1",
        ) as cluster,
        distributed.Client(cluster) as client,
        _ends_in_words("the local cluster", kept),
    ):
        yield _workers(client)


@contextmanager
def existing(address: str, *, kept: str = KEPT) -> Iterator[Workers]:
    """The workers of a running scheduler; those that join later take part, too.

    Args:
        address: such as tcp://host:8786.
        kept: what is said of the work done when it goes away.

    Raises:
        UnsupportedError: Dask is not installed, or the workers have no sonocal or another version of it.
        InputError: nobody answers, or there are no workers.
    """
    distributed = _distributed()
    try:
        client = distributed.Client(address, timeout=CONNECT_SECONDS)
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(
            f"{address}: no Dask scheduler answers there ({type(error).__name__}); start one with 'dask scheduler' and "
            "workers with 'dask worker ADDRESS --nthreads 1', and give the address that it prints"
        ) from None
    with client, _ends_in_words(address, kept):
        try:
            client.wait_for_workers(1, timeout=CONNECT_SECONDS)
        except TimeoutError:
            raise InputError(
                f"{address}: the scheduler has no workers; start some with 'dask worker {address} --nthreads 1'"
            ) from None
        _check_versions(client)
        yield _workers(client)


@contextmanager
def _ends_in_words(where: str, kept: str) -> Iterator[None]:
    """A cluster that goes away is no bug of ours."""
    from distributed import KilledWorker
    from distributed.comm.core import CommClosedError

    try:
        yield
    except (CommClosedError, CancelledError):
        raise InputError(
            f"{where}: the scheduler has gone; {kept}: start it again, and give the same command"
        ) from None
    except KilledWorker as error:
        raise InputError(
            f"{where}: one task has taken several workers with it, the last being {error.last_worker.address}; look at "
            f"that machine's memory and log; {kept}"
        ) from None


def _workers(client: Any) -> Workers:
    return Workers(_ClientExecutor(client), lambda: _count(client))


def _count(client: Any) -> int:
    from distributed.comm.core import CommClosedError

    try:
        return max(1, int(sum(client.nthreads().values())))
    except OSError as error:  # it does not answer any more
        raise CommClosedError(str(error)) from None


class _ClientExecutor(Executor):
    """A client's workers as an executor.

    Dask's own looks at a task's result and then at its state, between which a worker may die with the result: what it
    passes on then is an error. Here the result is asked for, and waited for where it must be computed again.
    """

    def __init__(self, client: Any) -> None:
        self._client = client

    def submit(self, function: Any, /, *arguments: Any, **keywords: Any) -> Future[Any]:
        """Have one of the workers do it."""
        theirs = self._client.submit(function, *arguments, **keywords, pure=False)
        ours: Future[Any] = Future()
        theirs.add_done_callback(lambda done: _pass_on(done, ours))
        ours.add_done_callback(lambda done: theirs.cancel() if done.cancelled() else None)
        return ours


def _pass_on(theirs: Any, ours: Future[Any]) -> None:
    with suppress(InvalidStateError):  # given up meanwhile
        try:
            ours.set_result(theirs.result())
        except InvalidStateError:
            raise
        except BaseException as error:
            ours.set_exception(error)


def _check_versions(client: Any) -> None:
    try:
        versions = set(client.run(program_version).values())
    except (ImportError, AttributeError):
        raise UnsupportedError(
            "the cluster's workers cannot import sonocal; install the same version of it on all"
        ) from None
    if versions != {program_version()}:
        raise UnsupportedError(
            f"the cluster's workers run sonocal {', '.join(sorted(versions))} and this is {program_version()}; "
            "install the same version on all"
        )


def _distributed() -> Any:
    try:
        import distributed
    except ImportError:
        raise UnsupportedError(
            "worker processes need Dask, which is not installed; pip install distributed"
        ) from None
    # A connection that closes while a cluster shuts down is no news.
    logging.getLogger("distributed").setLevel(logging.ERROR)
    return distributed
