"""Who sends to a port, and who may."""

from __future__ import annotations

import ipaddress
from collections import Counter, deque
from collections.abc import Sequence

_MOST_KNOWN = 100  # senders' addresses can be forged: there is no end to them

Network = ipaddress.IPv4Network | ipaddress.IPv6Network


class Senders:
    """The senders that a source has heard. ``allowed`` are their networks; none: everybody may send.

    ``refused`` counts what came from others, by reason; ``news`` names each of these once, and where everybody may
    send each but the first, as (level, text), and is emptied by who tells them.
    """

    def __init__(self, allowed: Sequence[Network]) -> None:
        self._allowed = tuple(allowed)
        self._known: dict[str, bool] = {}
        self.refused: Counter[str] = Counter()
        self.news: deque[tuple[str, str]] = deque()

    def admits(self, sender: str) -> bool:
        """Whether something from this address (IPv4 or IPv6, without a port) may come in."""
        may = self._known.get(sender)
        if may is None:
            may = self._is_allowed(sender)
            if len(self._known) < _MOST_KNOWN:
                if not may:
                    self.news.append(("warning", f"{sender} sends and may not"))
                elif self._known and not self._allowed:
                    self.news.append(("info", f"{sender} sends, too"))
                self._known[sender] = may
        if not may:
            self.refused["sender that is not allowed"] += 1
        return may

    def _is_allowed(self, sender: str) -> bool:
        address = ipaddress.ip_address(sender.partition("%")[0])
        return not self._allowed or any(address in network for network in self._allowed)
