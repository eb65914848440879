"""Dask clusters, whatever they are made of: processes of this machine, or jobs of a queueing system."""

from typing import Any

from voxgran._base.errors import ClusterError, InputError, MissingLibraryError, shown
from voxgran._base.lazy import load

#: seconds that a scheduler has to answer
ANSWER = 10.0


def address_of(dask: Any) -> str:
    """Return the address of a scheduler: as it is given, or that of a cluster or client.

    Raises
    ------
    InputError
        If it is none of these.
    """
    scheduler = getattr(dask, "scheduler", None)
    address = getattr(dask, "scheduler_address", getattr(scheduler, "address", dask))
    if not isinstance(address, str) or not address:
        raise InputError(f"dask is {shown(dask)}: it must be the address of a scheduler, as tcp://HOST:8786")
    return address


def connected(dask: Any, *, default: bool) -> Any:
    """Return a client of a cluster; if `default`, the one to which dask gives all work of this process from now on.

    Raises
    ------
    InputError
        If it is neither an address nor a cluster.
    MissingLibraryError
        If distributed is not installed.
    ClusterError
        If there is no scheduler.
    """
    address = address_of(dask)
    try:
        distributed = load("distributed")
    except MissingLibraryError as error:
        raise MissingLibraryError(f"{error}, or 'pip install voxgran[dask]'") from error
    try:
        known = distributed.default_client() if default else None
    except ValueError:
        known = None
    if known is not None and known.scheduler.address == address:
        return known
    try:
        client = distributed.Client(address, timeout=ANSWER, set_as_default=False)
        if default:
            # only now: a client that finds no scheduler would stay the default one
            client.close()
            client = distributed.Client(address, timeout=ANSWER)
        return client
    except (OSError, ValueError, TimeoutError) as error:
        raise ClusterError(
            f"there is no Dask scheduler at {address}: start one with 'dask scheduler', and check the address"
        ) from error
