"""Dask client: addresses of a wrong form, and schedulers that cannot be reached."""

import socket

import pytest

from asfm.errors import AsfmError
from asfm.study import dask_client
from asfm.study.dask_client import check_address, open_client

pytest.importorskip("distributed", reason="the extra cluster is not installed")


@pytest.mark.parametrize("address", ["tcp://host:8786", "host:8786", "tls://10.0.0.1:1", "tcp://[::1]:8786"])
def test_addresses_of_schedulers(address: str) -> None:
    check_address(address)


@pytest.mark.parametrize("address", ["", "host", "tcp://host", "host:port", "http://host:80/x", "a b:1", "tcp://:1"])
def test_other_addresses_are_refused(address: str) -> None:
    with pytest.raises(AsfmError, match="expected an address such as tcp://host:8786, found"):
        check_address(address)


@pytest.mark.parametrize("protocol", ["tcp", "ftp"])
def test_a_scheduler_that_is_not_there_is_one_line(protocol: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask_client, "CONNECT_S", 0.5)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))  # nobody listens
        address = f"{protocol}://127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(AsfmError, match=f"{address}: cannot reach a Dask scheduler there: "), open_client(address):
            pass
