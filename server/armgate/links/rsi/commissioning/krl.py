"""Files for a KRC: its RSI Ethernet file, and a KRL program that lets armgate correct the axes.

The program uses the names of public drivers and examples; it was not tried on a real controller.
"""

from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import escape

from armgate.links.rsi.axes import A_AXES, E_AXES, Axis
from armgate.links.rsi.config import RsiLinkConfig

GENERATIONS = ("rsi2", "rsi3")
"""RSI 2 on a KRC2; RSI 3 and later on a KRC4 or KRC5."""
_POSITIONS = (("A", ("AIPos", "ASPos")), ("E", ("EIPos", "ESPos")))


def ethernet_xml(
    axes: Sequence[Axis], host: str, port: int, sentype: str, relative: bool, generation: str
) -> str:
    """Return the RSI Ethernet file.

    Args:
        axes: The robot's axes.
        host: Address of the PC.
        port: Port on which the PC listens.
        sentype: Type attribute of replies.
        relative: True if corrections are added up: then a missing one must count as zero.
        generation: One of ``GENERATIONS``.
    """
    kinds = {axis.name[0] for axis in axes}
    sent = ["RIst", *(tag for kind, tags in _POSITIONS if kind in kinds for tag in tags)]
    send = [f'      <ELEMENT TAG="DEF_{tag}" TYPE="DOUBLE" INDX="INTERNAL"/>' for tag in sent]
    send.append('      <ELEMENT TAG="DEF_Delay" TYPE="LONG" INDX="INTERNAL"/>')
    hold, unit = int(not relative), ' UNIT="0"' if generation == "rsi2" else ""
    receive = [
        f'      <ELEMENT TAG="{_group(name)}.{name}" TYPE="DOUBLE" INDX="{index}"{unit} HOLDON="{hold}"/>'
        for index, name in enumerate(_corrected(axes), start=1)
    ]
    protocol = ["    <PROTOCOL>UDP</PROTOCOL>"] if generation == "rsi2" else []
    lines = [
        "<ROOT>", "  <CONFIG>",
        f"    <IP_NUMBER>{escape(host)}</IP_NUMBER>", f"    <PORT>{port}</PORT>", *protocol,
        f"    <SENTYPE>{escape(sentype)}</SENTYPE>", "    <ONLYSEND>FALSE</ONLYSEND>",
        "  </CONFIG>", "  <SEND>", "    <ELEMENTS>", *send, "    </ELEMENTS>", "  </SEND>",
        "  <RECEIVE>", "    <ELEMENTS>", *receive, "    </ELEMENTS>", "  </RECEIVE>", "</ROOT>",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def program(axes: Sequence[Axis], own: RsiLinkConfig, cycle: float, generation: str) -> str:
    """Return the KRL program, which uses the numbers that ``ethernet_xml`` gives to the values.

    Args:
        axes: The robot's axes.
        own: Configuration of the link.
        cycle: Cycle of the KRC, s.
        generation: One of ``GENERATIONS``.
    """
    lines = _rsi2(axes, own) if generation == "rsi2" else _rsi3(axes, own, cycle)
    return "\n".join(lines) + "\n"


def _mode(own: RsiLinkConfig) -> str:
    return "#RELATIVE" if own.mode == "relative" else "#ABSOLUTE"


def _file(own: RsiLinkConfig) -> str:
    return Path(own.ethernet).name


def _corrected(axes: Sequence[Axis]) -> list[str]:
    names = {axis.name for axis in axes}
    return [name for name in (*A_AXES, *E_AXES) if name in names]


def _group(name: str) -> str:
    return "AK" if name[0] == "A" else "EK"


def _rsi3(axes: Sequence[Axis], own: RsiLinkConfig, cycle: float) -> list[str]:
    names = _corrected(axes)
    links = [f";   ETHERNET Out{index} -> {_target(name)}" for index, name in enumerate(names, start=1)]
    external = [";   AXISCORREXT: the same for the external axes"] if any(n[0] == "E" for n in names) else []
    clock = "#IPO_FAST" if cycle < 0.012 else "#IPO"
    return [
        "DEF armgate_rsi( )",
        "; Lets armgate correct the axes. Create the context armgate.rsi in RSI Visual with:",
        f";   ETHERNET: ConfigFile {_file(own)}, Timeout {own.timeout}, Precision {own.precision}",
        *links,
        ";   AXISCORR: LowerLimA1, UpperLimA1, ...: as wide as the joints may move; it limits silently",
        *external,
        ";   AXISCORRMON: MaxA1, ...: a little wider; beyond it RSI stops. Without it the limit is 6 deg",
        "DECL INT ret, id",
        "BAS(#INITMOV, 0)",
        "PTP $AXIS_ACT ; the robot does not move",
        'ret = RSI_CREATE("armgate.rsi", id, TRUE)',
        "IF ret <> RSIOK THEN",
        "  HALT",
        "ENDIF",
        f"ret = RSI_ON({_mode(own)}, {clock})",
        "IF ret <> RSIOK THEN",
        "  HALT",
        "ENDIF",
        "RSI_MOVECORR( ) ; until it is stopped",
        "ret = RSI_OFF( )",
        "END",
    ]


def _target(name: str) -> str:
    return f"AXISCORR Corr{name}" if name[0] == "A" else f"AXISCORREXT Corr{name}"


def _rsi2(axes: Sequence[Axis], own: RsiLinkConfig) -> list[str]:
    # ST_AXISCORR has twelve inputs: A1 to A6, E1 to E6.
    inputs = {name: number for number, name in enumerate((*A_AXES, *E_AXES), start=1)}
    links = [
        f"err = ST_NEWLINK(hEthernet, {index}, hAxis, {inputs[name]}) ; {_group(name)}.{name}"
        for index, name in enumerate(_corrected(axes), start=1)
    ]
    return [
        "DEF armgate_rsi( )",
        f"; Lets armgate correct the axes. It expects {own.timeout} late cycles as the limit: set the same",
        "; limit in the Ethernet object. Set the limits of ST_AXISCORR as wide as the joints may",
        "; move: it limits corrections silently.",
        "DECL RSIERR err",
        "DECL INT hEthernet, hAxis",
        "BAS(#INITMOV, 0)",
        "PTP $AXIS_ACT ; the robot does not move",
        f'err = ST_ETHERNET(hEthernet, 0, "{_file(own)}")',
        "IF err <> #RSIOK THEN",
        "  HALT",
        "ENDIF",
        "err = ST_AXISCORR(hAxis, 0)",
        *links,
        f"err = ST_ON({_mode(own)})",
        "IF err <> #RSIOK THEN",
        "  HALT",
        "ENDIF",
        "ST_SKIPSENS( ) ; until it is stopped",
        "err = ST_OFF( )",
        "END",
    ]
