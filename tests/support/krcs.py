"""Virtual KRCs that tests run cycle by cycle, their RSI files, and a PC that replies like public drivers."""

import re
from pathlib import Path
from random import Random

from armgate.emulator.krc import PROFILES, Arrival, Context, Controller, Event, EventLog, kr16, read_ethernet

FILES = Path(__file__).parents[2] / "configs" / "rsi"
SENT = ("DEF_RIst", "DEF_AIPos", "DEF_ASPos", "DEF_Delay")
SIX = tuple(f"AK.A{number}" for number in range(1, 7))


def element(tag, index, type_="DOUBLE", hold=None):
    holdon = "" if hold is None else f' HOLDON="{hold}"'
    return f'<ELEMENT TAG="{tag}" TYPE="{type_}" INDX="{index}"{holdon}/>'


def krc_file(sent=SENT, received=SIX, hold=1, more="", sentype="ImFree", only_send="FALSE"):
    """Return the text of an RSI Ethernet file."""
    send = "".join(element(tag, "INTERNAL", "LONG" if tag == "DEF_Delay" else "DOUBLE") for tag in sent)
    receive = "".join(element(tag, number, hold=hold) for number, tag in enumerate(received, start=1))
    return (
        f"<ROOT><CONFIG><IP_NUMBER>127.0.0.1</IP_NUMBER><PORT>49152</PORT><SENTYPE>{sentype}</SENTYPE>"
        f"<ONLYSEND>{only_send}</ONLYSEND></CONFIG><SEND><ELEMENTS>{send}</ELEMENTS></SEND>"
        f"<RECEIVE><ELEMENTS>{receive}{more}</ELEMENTS></RECEIVE></ROOT>"
    )


def ethernet(**how):
    return read_ethernet(krc_file(**how).encode())


def sen(ipoc, axes=(0.0,) * 6, external=None, more="", sentype="ImFree", tag="AK"):
    """Return a reply."""
    numbers = "".join(f' A{number}="{value:.6f}"' for number, value in enumerate(axes, start=1))
    outer = "".join(f' E{number}="{value:.6f}"' for number, value in enumerate(external or (), start=1))
    outer = f"<EK{outer}/>" if outer else ""
    return f'<Sen Type="{sentype}"><{tag}{numbers}/>{outer}{more}<IPOC>{ipoc}</IPOC></Sen>'.encode()


def ipoc_of(telegram):
    return re.search(rb"<IPOC>(\d+)</IPOC></Rob>$", telegram)[1].decode()


def values_of(telegram, tag):
    """Return the numbers in an element of a telegram."""
    inner = re.search(rf"<{tag} ([^>]*)/>", telegram.decode())[1]
    return [float(text) for text in re.findall(r'="([^"]*)"', inner)]


class LogRecords(list):
    """Log that is a list of (level, event, text, fields)."""

    def __call__(self, level, event, text, **fields):
        self.append((level, event, text, fields))

    def texts(self, event):
        return [text for _, name, text, _ in self if name == event]


class ControllerRig:
    """Virtual KRC and the PC that replies to it, cycle by cycle."""

    def __init__(self, profile="krc4-rsi3", context=None, arm=None, ipoc=100, start=True, cycle=None, **file):
        self.profile = PROFILES[profile] if cycle is None else PROFILES[profile].in_cycle(cycle)
        self.log = LogRecords()
        self.controller = Controller(
            self.profile, context or Context(precision=6), ethernet(**file), arm or kr16(),
            chance=Random(1), log=EventLog(self.log), ipoc=ipoc,
        )  # fmt: skip
        self.telegram = None
        if start:
            assert self.controller.operate(Event.START) is None
            self.silent()

    @property
    def state(self):
        return self.controller.state.value

    @property
    def status(self):
        return self.controller.status()

    @property
    def delay(self):
        return self.status["delay"]

    @property
    def setpoint(self):
        return list(self.status["setpoint"].values())

    def get(self, *datagrams, age=0.001, stranger=None):
        """Run a cycle in which these datagrams arrive."""
        self.telegram = self.controller.cycle([Arrival(data, age, stranger) for data in datagrams])
        return self.telegram

    def silent(self, cycles=1):
        """Run cycles in which no reply arrives."""
        for _ in range(cycles):
            self.get()
        return self.telegram

    def answer(self, axes=(0.0,) * 6, cycles=1, **how):
        """Run cycles in which the PC replies correctly."""
        for _ in range(cycles):
            self.get(sen(ipoc_of(self.telegram), axes, **how))
        return self.telegram

    def operate(self, event):
        return self.controller.operate(Event(event))
