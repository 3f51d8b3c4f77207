"""`ports`: lists serial ports, and the boards that answer on them."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

from rich.table import Table

from ..io.boards.port import PortAnswer, ask, usb_ports
from ..io.reports.terminal import Terminal
from ..models.values.errors import TensegraphError


def list_ports(ports: Sequence[str], baud: int, seconds: float, terminal: Terminal) -> None:
    """Ask ports, or all USB serial ports, which board is on them, and print what they answer.

    Raises:
        TensegraphError: when there is no port to ask.
    """
    found = usb_ports()
    asked = {port: found.get(port, "") for port in ports} if ports else found
    if not asked:
        raise TensegraphError("no USB serial port: is a board plugged in?")
    with ThreadPoolExecutor(len(asked)) as pool:  # each waits for its own board
        answers = list(pool.map(lambda port: ask(port, asked[port], baud, seconds), asked))
    terminal.results.print(ports_table(answers))


def ports_table(answers: Sequence[PortAnswer]) -> Table:
    """Return a table of the answer of each port."""
    table = Table("port", "device", "board", "firmware", "boot", "rate", "channels")
    for a in answers:
        hello = a.hello
        cells = [str(a.board_id), "(lines)", "", ""] if a.board_id is not None else [a.error or "silent", "", "", ""]
        if hello is not None:
            cells = [str(hello.board_id), hello.firmware, str(hello.boot), f"{hello.rate_hz} Hz"]
        table.add_row(a.port, a.description, *cells, str(a.channels or ""))
    return table
