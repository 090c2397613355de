"""Forty ways in which a double can be more lenient than a control, each with the questions that must name it."""

from __future__ import annotations

from simulators.nck import Nck
from simulators.nck.channel import Channel
from simulators.nck.machine import files
from simulators.nck.machine.compensation import TableMemory
from simulators.nck.program import names
from simulators.nck.program.procedures import Variable
from simulators.opcua.address_space import Account, VariableSpace
from simulators.opcua.methods import Methods, ServedFiles
from simulators.opcua.sessions import SinumerikSession
from tests.conform.seeds import (
    Leniency,
    any_count,
    any_length,
    any_type,
    bool_of_two,
    clamped,
    divides,
    file_of,
    may_all,
    opens_by_zero,
    over_always,
    reads_missing,
    refusal_is,
    root,
    rule,
    selects,
    selects_always,
    single,
    stale,
    stamped,
    state_ok,
    typed,
    unlimited,
    unlocked,
    wrapped,
)

LENIENCIES = (
    rule("LENGTH", "block-length"),
    rule("END", "program-without-end"),
    rule("NAME", "name-of-one-letter"),
    rule("TWICE", "defined-twice", "label-twice"),
    rule("G-GROUP", "two-of-a-group"),
    rule("DIRECTION", "jump-direction"),
    rule("INTO", "jump-into"),
    rule("MSG", "message-length"),
    Leniency("rights of machine data", frozenset({"right-to-machine-datum"}), wrapped(Account, "may", may_all)),
    Leniency("type of a written value", frozenset({"write-r-type"}), wrapped(SinumerikSession, "_store", typed)),
    Leniency("time stamp of a write", frozenset({"write-r-stamped"}), wrapped(SinumerikSession, "_store", stamped)),
    Leniency("length of a block", frozenset({"write-r-block"}), wrapped(VariableSpace, "write", any_length)),
    Leniency(
        "write-protected variables",
        frozenset(
            {
                "write-state",
                "write-position",
                "write-version",
                "write-unknown",
                "write-r-beyond",
                "write-r-block",
                "write-datum-own",
            }
        ),
        refusal_is(VariableSpace, "write", None),
    ),
    Leniency(
        "arguments' types", frozenset({"send-type", "fetch-type", "select-type"}), wrapped(Methods, "call", any_type)
    ),
    Leniency(
        "too many arguments", frozenset({"fetch-arguments", "rights-arguments"}), wrapped(Methods, "call", any_count)
    ),
    Leniency(
        "file extensions",
        frozenset({"send-extension", "fetch-extension"}),
        file_of(lambda path: path.replace(".EXE", ".MPF")),
    ),
    Leniency(
        "folders",
        frozenset({"send-folder", "fetch-folder"}),
        file_of(lambda path: path.replace("/Nowhere/", "/Part Program/")),
    ),
    Leniency("long program names", frozenset({"send-long-name"}), file_of(lambda path: path.replace("X" * 18, "X"))),
    Leniency("leave to replace a file", frozenset({"send-over"}), wrapped(Methods, "_to_server", over_always)),
    Leniency("number of a channel", frozenset({"select-channel"}), wrapped(Nck, "select", selects)),
    Leniency("state of the channel", frozenset({"running-select"}), selects_always),
    Leniency(
        "a program in execution is replaced",
        frozenset({"running-send", "write-itself", "delete-itself"}),
        lambda patch: patch.setattr(Channel, "_check_changing", lambda self, path: None),
    ),
    Leniency("mode of an opened file", frozenset({"node-open-mode"}), wrapped(ServedFiles, "_open", opens_by_zero)),
    Leniency(
        "points behind the memory",
        frozenset(
            {
                "read-point-beyond",
                "read-point-negative",
                "read-cross-point-beyond",
                "write-point-beyond",
                "write-cross-point-beyond",
            }
        ),
        lambda patch: patch.setattr(TableMemory, "place", staticmethod(lambda points, number: 0)),
    ),
    Leniency(
        "cross tables behind the last",
        frozenset({"read-table-beyond"}),
        lambda patch: patch.setattr(TableMemory, "cec_table", lambda self, number: self.cec[number % len(self.cec)]),
    ),
    Leniency("a table that is on is written", frozenset({"locked-while-on"}), unlocked),
    Leniency("values out of range", frozenset({"write-direction", "write-product-negative"}), clamped),
    Leniency("upper limits of machine data", frozenset({"write-sum-above"}), unlimited("high")),
    Leniency("lower limits of machine data", frozenset({"write-sum-below"}), unlimited("low")),
    Leniency("a switch of two", frozenset({"write-switch"}), bool_of_two),
    Leniency("division by zero", frozenset({"divided-by-zero"}), divides),
    Leniency("digits of a point", frozenset({"resolution-of-points"}), wrapped(TableMemory, "kept", single)),
    Leniency("a replaced file stays", frozenset({"send-replaced", "delete-missing"}), stale),
    rule("CHARACTER", "character"),
    Leniency("root of a negative number", frozenset({"root-of-negative"}), root),
    Leniency("elements behind an array", frozenset({"array-index"}), refusal_is(Variable, "write", None)),
    Leniency("jump to nowhere", frozenset({"label-by-text"}), refusal_is(names.NameResolver, "jump", None)),
    Leniency("deleting what is not there", frozenset({"delete-missing"}), state_ok("remove", files.NO_FILE)),
    Leniency("writing nowhere", frozenset({"write-nowhere"}), state_ok("append", files.NO_PATH)),
    Leniency("reading what is not there", frozenset({"read-missing"}), reads_missing),
)
