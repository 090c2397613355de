"""Everything that a site file alone can tell: each mistake with its place, all of them at once."""

from __future__ import annotations

import json
import os
import re
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.errors import ConfigError, TrueflankError
from gateway.cli import app
from gateway.cli.setup.check import check_site, is_fault
from gateway.config import Fault, load_site, read_site
from gateway.config.faults import places_in

GEAR = Path(__file__).parents[3] / "examples/gears/rv-40e-like.toml"
EXAMPLES = Path(__file__).parents[3] / "examples/sites"
WHOLE = """[site]
name = "grinder-7"

[controller]
driver = "sinumerik-opcua"
url = "opc.tcp://192.168.214.1:4840"
serial = "YK-0007"

[controller.settings]
user = "OpcUaClient"
password_file = "password.txt"
server_certificate = "control.der"

[[instruments]]
name = "laser"
driver = "umd"
url = "COM5"
settings = { max_fringe_hz = 0.0 }
[[instruments]]
name = "ring"
driver = "bridge"
url = "tcp://127.0.0.1:7001"
settings = { max_speed_deg_s = 2000.0 }
[[axes]]
name = "X1"
letter = "X"
kind = "linear"
travel = [-420.0, 20.0]

[axes.measure]
instrument = "laser"
component = "EXX"
targets = { first = -400.0, last = 0.0, count = 21, offset_fraction = 0.2 }
feed = 6000.0
stable = 0.5

[axes.table]
minimum = -400.0
maximum = 0.0
step = 20.0

[[axes]]
name = "C1"
letter = "C"
kind = "rotary"
modulo = true
travel = [0.0, 360.0]

[axes.measure]
instrument = "ring"
component = "ECC"
targets = { first = 0.0, last = 345.0, count = 24 }
feed = 900.0
stable = 1.5
jog = 0.1

[axes.table]
minimum = 0.0
maximum = 360.0
step = 5.0

[[setups]]
axis = "X1"
component = "EYX"
instrument = "laser"
park = { C1 = 0.0 }

[moves]
safe = { X1 = [-400.0, 0.0], C1 = [0.0, 360.0], S1 = "any" }
"""

# (old, new, line, column, words that must be told)
MISTAKES = [
    ('driver = "umd"', 'driver = "udm"', 16, 10, "known: attocube-ids, bridge, bridge-gear, gauge, manual, umd"),
    ('driver = "sinumerik-opcua"', 'driver = "sinumerik-opc"', 5, 10, "did you mean sinumerik-opcua?"),
    ('name = "C1"', 'name = "x1"', 43, 8, "number 1 already has this name"),
    ('letter = "C"', 'letter = "X"', 44, 10, "axis number 1 already has this letter"),
    ('name = "ring"', 'name = "laser"', 20, 8, "number 1 already has this name"),
    ('name = "ring"', 'name = "controller"', 20, 8, "another name"),
    ('"EXX"', '"EXQ"', 32, 13, "EXX"),
    ('"EXX"', '"EZZ"', 32, 13, "axis X1: measure.component"),
    ('"EYX"', '"EQX"', 64, 13, "must be an error motion"),
    ('"EYX"', '"EYZ"', 64, 13, "did you mean EYX?"),
    ('"EYX"', '"B0C"', 64, 13, "B0C on Z"),
    ("X1 = [-400.0, 0.0]", "X1 = [0.0, -400.0]", 69, 15, "the lower limit first"),
    ("X1 = [-400.0, 0.0]", "X1 = [100.0, 400.0]", 69, 15, "travel"),
    ("X1 = [-400.0, 0.0]", "X1 = 3", 69, 15, "moves.safe.X1"),
    ("minimum = -400.0", "minimum = -500.0", 38, 11, "travel -420 to 20"),
    ("minimum = -400.0\nmaximum = 0.0", "minimum = 0.0\nmaximum = -400.0", 40, 8, "minimum must be below maximum"),
    ("step = 20.0", "step = 19.0", 40, 8, "step must divide"),
    ("first = -400.0", "first = -500.0", 33, 21, "must be within the travel"),
    ("first = -400.0, last = 0.0", "first = 0.0, last = 0.0", 33, 33, "must differ from first"),
    ("count = 21, off", "count = 9, window = { first = 1.0, last = 90.0, step = 1.0 }, off", 33, 83, "must be within"),
    ("count = 24", "count = 1", 52, 48, "count must be 2 or more"),
    ("count = 24", 'count = "iso"', 52, 48, '"iso230-2"'),
    ("first = 0.0, last = 345.0, count = 24", "positions = [0.0, 90.0, 90.0]", 52, 37, "twice"),
    ('user = "OpcUaClient"', 'usr = "OpcUaClient"', 10, 1, "did you mean user?"),
    ('user = "OpcUaClient"', "r_first = 40000", 10, 11, "32515 at most"),
    ('user = "OpcUaClient"', 'security = "none"', 10, 12, "must be"),
    ('user = "OpcUaClient"', "poll_s = nan", 10, 10, "finite"),
    ('user = "OpcUaClient"', 'password = "x"', 9, 1, "password_file"),
    ("feed = 6000.0", "fed = 6000.0", 34, 1, "did you mean feed?"),
    ("feed = 6000.0", "", 30, 1, "axis X1: measure.feed: is missing"),
    ("feed = 6000.0", 'feed = "6000"', 34, 8, "must be a number"),
    ("feed = 6000.0", "feed = true", 34, 8, "must be a number"),
    ("feed = 6000.0", "feed = -6000.0", 34, 8, "must be above 0"),
    ("feed = 6000.0", "feed = inf", 34, 8, "finite"),
    ("feed = 6000.0", "feed = 6000.0\nexpansion_ppm_per_k = nan", 35, 23, "finite"),
    ("feed = 6000.0", "feed = 6000.0\nexpansion_ppm_per_k = 1150.0", 35, 23, "100 at most"),
    ("feed = 6000.0", "feed = 6000.0\nrepetitions = 5.5", 35, 15, "whole number"),
    ("feed = 6000.0", 'feed = 6000.0\ncycle = "pendular"', 35, 9, "did you mean pendulum?"),
    ('kind = "rotary"', 'kind = "linear"', 45, 8, "axis C is rotary"),
    ('kind = "linear"', 'kind = "rotary"', 27, 8, "axis X is linear"),
    ('kind = "linear"', 'kind = "liner"', 27, 8, "did you mean linear?"),
    ("travel = [-420.0, 20.0]", "travel = [20.0, -420.0]", 28, 10, "the lower limit first"),
    ("travel = [-420.0, 20.0]", "travel = [-420,5, 20.0]", 28, 10, "decimal comma"),
    ("travel = [-420.0, 20.0]", "travel = [-420.0, 20.0]\nreference = 30.0", 29, 13, "zero there"),
    ("travel = [-420.0, 20.0]", "travel = [-420.0, 20.0]\nmodulo = true", 29, 10, "only a rotary axis"),
    ("travel = [-420.0, 20.0]", "travel = [-420.0, 20.0]\nencoder = 2", 29, 11, "1 at most"),
    ("travel = [0.0, 360.0]", "travel = [0.0, 720.0]", 47, 10, "from 0 to 360 deg"),
    ('instrument = "ring"', 'instrument = "rign"', 50, 14, "did you mean ring?"),
    ('url = "COM5"', 'url = "COM"', 17, 7, "COM3"),
    ('url = "COM5"', 'url = "http://laser"', 17, 7, "socket://"),
    (":4840", ":99999", 6, 7, "65535"),
    ("tcp://127.0.0.1:7001", "tcp://127.0.0.1", 22, 7, "host and a port"),
    ("192.168.214.1", "ann:pw@192.168.214.1", 6, 7, "password_file"),
    ("park = { C1 = 0.0 }", "park = { D1 = 0.0 }", 66, 15, "known: C1"),
    ("park = { C1 = 0.0 }", "park = { X1 = 0.0 }", 66, 15, "cannot be parked"),
    ('axis = "X1"', 'axis = "X2"', 63, 8, "did you mean X1?"),
    ('name = "grinder-7"', 'name = "../grinder"', 2, 8, "without blanks"),
    ('name = "laser"', 'name = "CON"', 15, 8, "a device name"),
    (":4840", ":70000", 6, 7, "65535"),
    ("192.168.214.1", "192.168.214.256", 6, 7, "needs a host"),
    ("192.168.214.1", "224.0.0.1", 6, 7, "needs a host"),
    ("{ first = -400.0, last = 0.0, count = 21, offset_fraction = 0.2 }", "[-400, 0]", 33, 11, "its own keys"),
    ('axis = "X1"', 'axis = "X"', 63, 8, "did you mean X1?"),
    ("[controller]", "[controler]", 4, 1, "did you mean controller?"),
    ("[controller]", "[[controller]]", 4, 1, "single brackets"),
    ('[[axes]]\nname = "C1"', '[[axis]]\nname = "C1"', 42, 1, "did you mean axes?"),
    ("travel = [-420.0, 20.0]", "travel = [-420.0]", 28, 10, "must have 2 values, not 1"),
    ("travel = [-420.0, 20.0]", "travel = 440.0", 28, 10, "a list of 2 numbers"),
    ("travel = [-420.0, 20.0]", "travel = { low = -420.0 }", 28, 10, "a list of 2 numbers"),
    ("travel = [-420.0, 20.0]", "min = -420.0", 28, 1, "did you mean travel?"),
    ("maximum = 360.0", "maximum = 345.0", 59, 11, "covers one turn"),
    ('instrument = "ring"', 'instrument = "laser"', 50, 14, "needs a rotary calibrator"),
    ("settings = { max_fringe_hz = 0.0 }", "settings = { optics_spacing_mm = 30.0 }", 31, 14, "reads arcsec, but EXX"),
    ("settings = { max_fringe_hz = 0.0 }", "settings = { max_fringe_hz = 1e5 }", 34, 8, "at most 1899 mm/min"),
    (
        "settings = { max_fringe_hz = 0.0 }",
        "settings = { max_speed_mm_s = 50.0 }",
        34,
        8,
        "6000 mm/min, at most 3000 mm/min",
    ),
    ("max_speed_deg_s = 2000.0", "max_speed_deg_s = 12.0", 53, 8, "900 deg/min, at most 720 deg/min"),
    ('"EYX"', '"EBX"', 65, 14, "reads mm, but EBX"),
    ('url = "COM5"', 'url = "COM0"', 17, 7, "is not an address"),
    ('url = "COM5"', 'port = "COM5"', 17, 1, "did you mean url?"),
    (
        'url = "COM5"',
        'url = "COM5"\nbaudrate = 9600',
        18,
        1,
        "[instrument.settings]",
    ),
    ('serial = "YK-0007"', 'serial = ""', 7, 10, "must not be empty"),
    ('password_file = "password.txt"\n', "", 9, 1, "password_env"),
    ('user = "OpcUaClient"\n', "", 9, 1, "who signs in"),
    ('"password.txt"', '"D:\\new\\table.txt"', 11, 17, "a backslash in double quotes"),
    ("[controller.settings]", "[settings]", 9, 1, "there is no key settings"),
    ("[axes.table]", "[axis.table]", 37, 1, "did you mean axes?"),
    ("[[setups]]", "[setups]", 62, 1, "[[setups]]"),
    ('[[axes]]\nname = "C1"', '[axes]\nname = "C1"', 42, 1, "[[axes]]"),
    ('instrument = "laser"\npark', "park", 62, 1, "instrument: a live set-up needs"),
    ("park = { C1 = 0.0 }", 'source = "none"', 62, 1, "assumed"),
    ('S1 = "any"', 'S1 = "Any"', 69, 54, "did you mean any?"),
    ('S1 = "any"', "S1 = [0.0]", 69, 54, "must have 2 values, not 1"),
    ("[moves]", "[service.mqtt]\nhost = 'tcp://b:1883'\n[moves]", 69, 8, "not a host name"),
    ("[moves]", "[report]\ncountry = 'Germany'\n[moves]", 69, 11, "two capital letters"),
    ("[moves]", "[[equipment]]\nname = 'head'\ncalibrated = '10.1.2026'\n[moves]", 70, 14, "YYYY-MM-DD"),
    ("[moves]", "[[tolerances]]\naxis = 'X1'\nlimits = { A = -8.0 }\n[moves]", 70, 16, "tolerance of X1: limits.A"),
    ("[moves]", "[[tolerances]]\naxis = 'X1'\nlimits = {}\n[moves]", 70, 10, "names no limit"),
    ("[moves]", "[[tolerances]]\naxis = 'X1'\nlimits = { a = 8.0 }\n[moves]", 70, 16, "did you mean A?"),
    ("[moves]", "[machine]\nwork_side = ['Q']\n[moves]", 69, 14, "letters of axes"),
    ("[moves]", "[machine]\nwork_side = ['X']\ntool_side = ['Z', 'X']\n[moves]", 70, 19, "is here already"),
    ("park = { C1 = 0.0 }", "offset_mm = [0.0, 0.0, 150000.0]", 66, 24, "10000 at most"),
    ("[moves]", "[report]\nnumber_prefix = 'No 1'\n[moves]", 69, 17, "without blanks"),
    ("first = -400.0, last = 0.0, count = 21", f"positions = {[*range(-400, 0)] * 6}", 33, 25, "2000 values at most"),
    ("[[setups]]", "[[axes.setups]]", 62, 1, "this key belongs to [[setups]]"),
    ("192.168.214.1", "192.168,214.1", 6, 7, "needs a host"),
    ("192.168.214.1", "\u0441ontrol-7", 6, 7, "needs a host"),
]

BROKEN = [
    ("stable = 0.5", "stable = 0,5", 35, "decimal point"),
    ('url = "COM5"', r'url = "C:\Users\ann"', 17, "single quotes"),
    ('url = "COM5"', r'url = "\\.\COM12"', 17, "single quotes"),
    ("stable = 0.5", "stable = 0.5\nstable = 0.6", 36, "occurs earlier"),
    ("modulo = true", "modulo = True", 46, "lower case"),
    ('letter = "X"', "letter = X", 26, "double quotes"),
    ("[site]", "[site", 1, ""),
    ("[axes.table]", "[site]", 37, "twice"),
    ("travel = [-420.0, 20.0]", "travel = [-420.0; 20.0]", 28, "comma"),
    ("stable = 0.5", "stable = 1.000.0", 35, "one decimal point"),
    ("feed = 6000.0", "feed = 6,000.0", 34, "no separators between thousands"),
    ('letter = "X"', 'letter = "X  # the infeed', 26, "no closing quote"),
    ('letter = "X"', "letter = 'X  # the infeed", 26, "no closing quote"),
    ("travel = [-420.0, 20.0]", "travel = [-420.0, 20.0  # mm", 28, "not closed"),
    ("travel = [-420.0, 20.0]", "travel = [-420.0 20.0]", 28, "a comma is missing"),
    ("park = { C1 = 0.0 }", "park = { C1 = 0.0", 66, "not closed"),
    ('letter = "X"', "letter = \u201cX\u201d", 26, "straight quotes"),
    ('letter = "X"', 'letter\u00a0= "X"', 26, "does not break"),
    ('letter = "X"', 'letter = "X\x07"', 26, "invisible"),
    ("[moves]", "\ufeff[moves]", 68, "invisible"),
    ("minimum = -400.0", "minimum = \u2212400.0", 38, "minus sign of the keyboard"),
    ("feed = 6000.0", "feed: 6000.0", 34, "key = value"),
    ("feed = 6000.0", "feed 6000.0", 34, "key = value"),
    ("feed = 6000.0", "feed =  # mm/min", 34, "the value is missing"),
    ("feed = 6000.0", "feed = null", 34, "the value is missing"),
    ("feed = 6000.0", "feed = 6000.0 // mm/min", 34, "begin a comment with #"),
    ("feed = 6000.0", "feed = 6000 mm/min", 34, "the number alone"),
    ("stable = 0.5", "stable = .5", 35, "before and behind the decimal point"),
    ("[axes.table]", "[axes.table", 37, "alone in [ ]"),
    ("[axes.table]", "(axes.table)", 37, "alone in [ ]"),
    ("feed = 6000.0", "feed == 6000.0", 34, "key = value"),
    ("feed = 6000.0", "feed = 6000.0,", 34, "the last comma"),
    ("feed = 6000.0", "feed = 6 000.0", 34, "between thousands"),
    ("feed = 6000.0", "feed = 6'000.0", 34, "between thousands"),
    ("feed = 6000.0", "feed = NaN", 34, "give a number"),
    ("feed = 6000.0", "feed = 100*60", 34, "nothing is calculated"),
    ("feed = 6000.0", "feed = 6000.0 overrun = 5.0", 34, "its own line"),
    ("feed = 6000.0", "max feed = 6000.0", 34, "one word"),
    ("feed = 6000.0", "; mm/min\nfeed = 6000.0", 34, "comment with #"),
    ("feed = 6000.0", "// mm/min\nfeed = 6000.0", 34, "comment with #"),
    ('letter = "X"', 'letter = ""X""', 26, "doubled"),
    ("first = -400.0, last = 0.0", "first = -400,0, last = 0,0", 33, "not a comma"),
    ("first = -400.0, last = 0.0", "first: -400.0, last: 0.0", 33, "key = value"),
    ("first = -400.0, last = 0.0", "first = -400.0; last = 0.0", 33, "with a comma"),
    ("first = -400.0, last = 0.0", "first = -400.0, first = 0.0", 33, "first occurs earlier"),
    ("offset_fraction = 0.2 }", "offset_fraction = 0.2, }", 33, "the last comma"),
    ("targets = { first = -400.0, last = 0.0,", "targets = {\n  first = -400.0,\n  last = 0.0,\n ", 33, "on one line"),
    ("{ first = -400.0, last = 0.0, count = 21, offset_fraction = 0.2 }", "(-400.0, 0.0)", 33, "square brackets"),
    ("feed = 6000.0", "feed = \uff16\uff10\uff10\uff10", 34, "full-width"),
    ("travel = [-420.0, 20.0]", "travel = [-420.0\u3001 20.0]", 28, "full-width"),
    ("[moves]", "[machine]\nyear = 10.01.2026\n[moves]", 69, "year-month-day"),
]

# (old, new, line, words of the doubt)
DOUBTS = [
    ("settings = { max_fringe_hz = 0.0 }", "", 14, "how fast it follows a motion"),
    ("settings = { max_speed_deg_s = 2000.0 }", "", 19, "enter max_speed_mm_s, max_speed_deg_s from the data sheet"),
    ("first = -400.0, last = 0.0", "first = 0.0, last = -400.0", 33, "rising order"),
    ("first = 0.0, last = 345.0, count = 24", "positions = [0.0, 90.0, 45.0]", 52, "rising order"),
    ("first = 0.0, last = 345.0, count = 24", "first = 10.0, count = 24", 52, "last is left out"),
    ("X1 = [-400.0, 0.0]", "X1 = [-500.0, 0.0]", 69, "travel -420 to 20"),
    ("C1 = [0.0, 360.0]", "C11 = [0.0, 360.0]", 69, "did you mean C1?"),
    ("C1 = [0.0, 360.0], ", "", 69, "no safe place for C1"),
    ("feed = 6000.0", "feed = 6.0", 34, "takes 73 min; the unit is mm/min"),
    ("feed = 900.0", "feed = 2.5", 53, "the unit is deg/min"),
    ("stable = 0.5", "stable = 0.0005", 35, "the unit is \N{MICRO SIGN}m"),
    ("stable = 1.5", "stable = 0.0004", 54, "the unit is arcsec"),
    ("feed = 6000.0", "feed = 6000.0\nexpansion_ppm_per_k = 0.0000115", 35, "1e-6/K"),
    ("feed = 6000.0", "feed = 6000.0\ndwell_s = 500", 35, "the unit is s"),
    ("feed = 6000.0", "feed = 6000.0\nfile_datum = 0.0", 35, "no effect without file"),
    ("park = { C1 = 0.0 }", 'path = "eyx.rtl"', 66, 'with source = "live"'),
    ("travel = [-420.0, 20.0]", "travel = [-420.0, 20.0]\nreference = 10.0", 29, "does not contain the reference"),
    ("last = 345.0, count = 24", "last = 6.02, count = 24", 59, "beyond the targets"),
    ("first = -400.0, last = 0.0, count = 21", "first = -200.0, last = 0.0, count = 21", 38, "a push refuses"),
    ("count = 21, ", "count = 3, ", 33, "5 targets or more"),
    ('"tcp://127.0.0.1:7001"', '"COM5"', 22, "the address of laser too"),
    (
        '"bridge"\nurl = "tcp://127.0.0.1:7001"\nsettings = { max_speed_deg_s = 2000.0 }',
        '"manual"\nurl = "terminal://"\n',
        50,
        "from result files only",
    ),
    ('"EYX"', '"B0Z"', 64, "second set-up, along Z"),
    ('url = "COM5"', 'url = "/dev/ttyUSB77"', 17, "no such port"),
    (
        "settings = { max_fringe_hz = 0.0 }",
        "settings = { max_fringe_hz = 0.0, wavelength_nm = 532.0 }",
        18,
        "632.99 nm",
    ),
    (
        "settings = { max_fringe_hz = 0.0 }",
        "settings = { max_fringe_hz = 0.0, baudrate = 9601 }",
        18,
        "did you mean 9600?",
    ),
    ("max_speed_deg_s = 2000.0", "max_speed_deg_s = 2000.0, baudrate = 115000", 23, "did you mean 115200?"),
    ("feed = 6000.0", "feed = 6000.0\naverage_s = 0.001", 35, "too short"),
    ("feed = 6000.0", "feed = 600000.0", 34, "faster than a machine tool measures; the unit is mm/min"),
    ("feed = 900.0", "feed = 90000.0", 53, "the unit is deg/min"),
    ("jog = 0.1", "jog = 10.0", 55, "0.1 is usual"),
    ("[moves]", "[assumed]\nlinear_um = 0.005\n[moves]", 69, "less than any machine has"),
    ("feed = 6000.0", "feed = 6000.0\nrepetitions = 1", 35, "fewer than 3 repetitions"),
    ("[moves]", "[machine]\nyear = 2150\n[moves]", 69, "a day to come"),
    ("[moves]", "[gear_tolerance]\nlimits = { F_p = 0.02 }\n[moves]", 69, "less than any machine keeps"),
    ("[moves]", "[assumed]\nangular_arcsec = 5000.0\n[moves]", 69, "more than any machine tool has"),
    (
        "[moves]",
        "[[tolerances]]\naxis = 'X1'\nlimits = { A = 8000.0 }\n[moves]",
        70,
        "more than any machine tool is allowed",
    ),
    ("X1 = [-400.0, 0.0]", 'X1 = "any"', 69, "suits a spindle"),
    ("[moves]", "[moves]\nfeed_mm = 0.5", 69, "the unit is mm/min"),
    ("[moves]", "[moves]\nfeed_deg = 0.1", 69, "the unit is deg/min"),
    ("feed = 6000.0", "feed = 6000.0\njog = 0.001", 35, "may not show its direction"),
    ("feed = 6000.0", "feed = 6000.0\nexpansion_ppm_per_k = 0.0115", 35, "1e-6/K"),
    ("step = 20.0", "step = 400.0", 40, "only 2 points"),
    ("[site]\n", "[site]\nstore = '/nowhere/runs'\n", 2, "no folder /nowhere yet"),
    ("[moves]", "[service.mqtt]\nhost = 'b'\nuser = 'u'\n[moves]", 70, "without a password"),
    ("[moves]", "[service.mqtt]\nhost = 'b'\nport = 8883\n[moves]", 70, "clear text"),
    ("[moves]", "[[equipment]]\nname = 'a'\n[[equipment]]\nname = 'a'\n[moves]", 71, "same name and serial"),
    ("[moves]", "[[equipment]]\nname = 'head'\ndue = 2021-01-10\n[moves]", 70, "due on 2021-01-10"),
    ("[moves]", "[[equipment]]\nname = 'head'\ncalibrated = 2199-01-10\n[moves]", 70, "a day to come"),
    ("[moves]", "[[tolerances]]\naxis = 'X1'\nlimits = { A = 0.008 }\n[moves]", 70, "arcsec"),
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "password.txt").write_text("secret\n")
    (tmp_path / "password.txt").chmod(0o600)
    (tmp_path / "control.der").write_bytes(b"\x30\x82")
    return tmp_path


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "site.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def changed(old: str, new: str) -> str:
    assert old in WHOLE
    return WHOLE.replace(old, new, 1)


@pytest.mark.skipif(os.name == "nt", reason="there it is a path like any other")
def test_a_path_of_windows_is_doubted_elsewhere(folder: Path) -> None:
    site = changed('name = "grinder-7"', "name = \"grinder-7\"\nstore = 'C:\\runs'")
    (doubt,) = check_site(written(folder, site)).doubts
    assert (doubt.line, doubt.path) == (3, ("site", "store"))
    assert "written for Windows" in str(doubt.fields["why"])


def test_the_whole_file_is_valid(folder: Path) -> None:
    found = check_site(written(folder, WHOLE))
    assert (found.faults, found.doubts) == ((), ())
    assert found.site.controller.settings["password_file"] == str(folder / "password.txt")


@pytest.mark.parametrize(("old", "new", "line", "column", "told"), MISTAKES)
def test_each_mistake_is_told_with_its_place(
    folder: Path, old: str, new: str, line: int, column: int, told: str
) -> None:
    found = check_site(written(folder, changed(old, new)))
    errors = {(fault.line, fault.column): str(fault.error("f")) for fault in found.faults}
    assert told in errors[line, column]
    assert f"f:{line}:{column}" in errors[line, column]


@pytest.mark.parametrize(("old", "new", "line", "told"), BROKEN)
def test_what_is_no_toml_is_told_with_what_was_meant(folder: Path, old: str, new: str, line: int, told: str) -> None:
    first = read_site(written(folder, changed(old, new))).faults[0]
    assert (first.code, first.line) == ("E-CFG-TOML", line)
    assert told in first.error("f").what


@pytest.mark.parametrize(("old", "new", "line", "told"), DOUBTS)
def test_what_is_unusual_is_told_and_does_not_refuse_the_file(
    folder: Path, old: str, new: str, line: int, told: str
) -> None:
    found = check_site(written(folder, changed(old, new)))
    assert found.faults == ()
    assert any(told in str(one.error("f")) for one in found.doubts if one.line == line)


@pytest.mark.parametrize(("old", "new"), [(old, new) for old, new, _, _ in BROKEN])
def test_a_line_that_cannot_be_read_is_the_only_fault(folder: Path, old: str, new: str) -> None:
    found = check_site(written(folder, changed(old, new))).faults
    assert {fault.code for fault in found} == {"E-CFG-TOML"} or "twice" in str(found[0].error("f"))


def test_single_brackets_of_a_list_are_one_fault_each(folder: Path) -> None:
    found = check_site(written(folder, WHOLE.replace("[[axes]]", "[axes]"))).faults
    assert [fault.line for fault in found] == [24, 42]


def test_a_file_that_says_nothing_is_told_how_to_begin(folder: Path) -> None:
    for text in ("", "  \n\n", "# a site\n"):
        (fault,) = check_site(written(folder, text)).faults
        assert "trueflank init" in str(fault.error("f"))


def test_instruments_that_are_named_and_nowhere_described_are_missed(folder: Path) -> None:
    """In a file without the section nobody asked for a name that no section has: the file was called valid."""
    text = re.sub(r"\[\[instruments\]\]\n((?!\[\[axes).+\n)+", "", WHOLE)
    (fault,) = check_site(written(folder, text)).faults
    assert (fault.line, fault.column, fault.path) == (1, 1, ("instruments",))
    assert "no [[instruments]] section, and axis X1: measure.instrument names laser" in str(fault.error("f"))
    mistyped = WHOLE.replace("[[instruments]]", "[[instrument]]")
    assert {fault.code for fault in check_site(written(folder, mistyped)).faults} == {"E-CFG-KEY"}


def test_a_blank_in_the_name_of_an_axis_is_doubted(folder: Path) -> None:
    found = check_site(written(folder, WHOLE.replace('"X1"', '"X 1"')))
    assert (25, "no control names an axis so") in [(one.line, str(one.fields["why"])[:27]) for one in found.doubts]


def test_an_empty_list_is_not_taken_for_a_decimal_comma(folder: Path) -> None:
    text = "axes = []\n" + re.sub(r"\[\[axes\]\](.|\n)*?(?=\[\[setups)", "", WHOLE)
    told = [str(fault.error("f")) for fault in check_site(written(folder, text)).faults if fault.path == ("axes",)]
    assert ["is empty: give one at least" in one and "decimal comma" not in one for one in told] == [True]


WORK = """
[work]
gear = "gear.toml"
height_mm = 150.0
infeed = "X1"
stroke = "Z"
index = "C"
"""
STROKE = """
[[axes]]
name = "Z1"
letter = "Z"
kind = "linear"
travel = [-10.0, 320.0]
measure = { instrument = "laser", component = "EZZ", feed = 3000.0, stable = 0.5, targets = { positions = AT } }
table = { minimum = 0.0, maximum = 300.0, step = 20.0 }
"""


@pytest.mark.parametrize(
    ("old", "new", "key", "told"),
    [
        ("150.0", "1500.0", "height_mm", "outside its travel"),
        ("150.0", '150.0\ndresser = "X1"', "dresser", "infeed axis already"),
        ("150.0", '150.0\ndresser_letter = "X"', "dresser_letter", "which axis X1 has"),
        ("150.0", '150.0\nwheel_place = "Y1"', "wheel_place", "carries the dresser"),
        ("150.0", '150.0\nwheel_place = "r200"', "wheel_place", "write R200 if that is meant"),
        ("150.0", '150.0\nwheel_place = "R 200"', "wheel_place", "write R200 if that is meant"),
        (
            "150.0",
            '150.0\nwheel_place = "R200.5"',
            "wheel_place",
            "neither an axis of the site file nor a parameter",
        ),
        ("150.0", '150.0\nwheel_place = "x1"', "wheel_place", "write X1 if that is meant"),
        ("150.0", '150.0\nwheel_place = "Z1"', "wheel_place", "stroke axis already"),
        ("150.0", '150.0\nwheel_place = "V1"\nwheel_letter = "Y"', "wheel_letter", "which axis Y1 has"),
        ("150.0", '150.0\nwheel_place = "V1"\nwheel_travel = [1.0, 5.0]', "wheel_travel", "outside its travel"),
        ("150.0", "150.0\nstock_mm = 1.5", "stock_mm", "needs overrun_mm of at least 22.6"),
        ("150.0", "150.0\nair_cut_feed = 600.0", "air_cut_feed", "500"),
        ("150.0", "150.0\nrough_mm = [0.02, 0.05]", "rough_mm", "less than the stock"),
        ("150.0", "150.0\nrough_mm = [50.0]", "rough_mm", "0.5"),
        ("150.0", '150.0\nwheel_on = "M3 G0 X0"', "wheel_on", "M functions"),
    ],
)
def test_what_forbids_a_test_part_is_told(folder: Path, old: str, new: str, key: str, told: str) -> None:
    shutil.copy(GEAR, folder / "gear.toml")
    stroke = STROKE.replace("AT", str([*range(0, 301, 20)]))
    whole = WHOLE.replace("[[setups]]", f"{stroke}\n[[setups]]") + WORK
    assert check_site(written(folder, whole)).faults == ()
    found = check_site(written(folder, whole.replace(old, new, 1)))
    said = [str(one.error("f")) for one in (*found.faults, *found.doubts) if key in one.path]
    assert [told in one for one in said] == [True]


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("zp = 40\nzc = 39", "zp = 39\nzc = 40", "39 pins do not match 40 lobes"),
        ("rrp = 3.0", "rrp = 30.0", "must be below 4.612 mm -> correct the gear file: use a smaller pin"),
        ("centre_distance_mm = 160.0", "centre_distance_mm = 62.0", "62.0 mm must be above 62.3 mm"),
        ("profile = 11", "profile = 2", "greater than or equal to 3"),
    ],
)
def test_a_gear_that_cannot_be_built_is_told_with_its_limit(folder: Path, old: str, new: str, told: str) -> None:
    gear = re.sub(r"[ \t]*#.*", "", GEAR.read_text(encoding="utf-8"))
    assert old in gear
    (folder / "gear.toml").write_text(gear.replace(old, new))
    stroke = STROKE.replace("AT", str([*range(0, 301, 20)]))
    whole = WHOLE.replace("[[setups]]", f"{stroke}\n[[setups]]") + WORK
    done = CliRunner().invoke(app, ["check", str(written(folder, whole))])
    assert done.exit_code == 2
    assert told in " ".join(done.output.split())
    assert "valid" not in done.output


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [('serial = "', 'serial = "ST ', "serial"), ("[[setups]]", "[[setups]]\nU = 120.0", "U")],
)
def test_a_blank_in_a_serial_number_and_an_instrument_of_120_um_are_refused(
    folder: Path, old: str, new: str, key: str
) -> None:
    found = check_site(written(folder, WHOLE.replace(old, new, 1)))
    assert [fault.path[-1] for fault in found.faults] == [key]


def test_an_error_code_is_never_a_doubt_beside_a_valid_file(folder: Path) -> None:
    shutil.copy(GEAR, folder / "gear.toml")
    stroke = STROKE.replace("AT", str([*range(0, 301, 20)]))
    whole = (WHOLE.replace("[[setups]]", f"{stroke}\n[[setups]]") + WORK).replace("150.0", "1500.0", 1)
    done = CliRunner().invoke(app, ["check", str(written(folder, whole))])
    assert (done.exit_code, "valid" in done.output, re.findall(r"\bE-[A-Z]", done.output)) == (0, True, [])
    assert "W-CFG-NO-PART" in done.output
    assert is_fault(Fault(("work",), "E-GRIND-VALUE", doubt=True))


def test_files_of_service_and_report_are_looked_for(folder: Path) -> None:
    (folder / "server.pem").write_text("-----BEGIN CERTIFICATE-----")
    text = WHOLE + '[report]\nlogo = "logo.png"\n[service]\nwatch = "in"\ncertificate = "server.pem"\nkey = "key.pem"\n'
    text += '[service.mqtt]\nhost = "plant"\nca = "ca.pem"\npassword_file = "control.der"\n'
    found = check_site(written(folder, text)).faults
    assert [fault.path[-1] for fault in found] == ["logo", "watch", "key", "ca", "password_file"]


def test_a_name_on_a_line_that_cannot_be_read_is_no_fault_elsewhere(folder: Path) -> None:
    found = check_site(written(folder, changed('name = "X1"', "name = \u201cX1\u201d")))
    assert [fault.line for fault in found.faults] == [25]


def test_no_axis_serves_twice_in_the_work(folder: Path) -> None:
    work = '[work]\ngear = "gear.toml"\nheight_mm = 150.0\ninfeed = "X"\nstroke = "X1"\nindex = "C"\n'
    found = check_site(written(folder, f"{WHOLE}\n{work}"))
    told = {fault.path: str(fault.error("f")) for fault in found.faults}
    assert "this axis is the infeed axis already" in told["work", "stroke"]


def test_a_set_up_of_no_axis_is_told_by_the_command(folder: Path) -> None:
    done = CliRunner().invoke(app, ["check", str(written(folder, changed('axis = "X1"', 'axis = "Q1"')))])
    assert done.exit_code == 2
    assert "there is no axis of that name" in done.output


@pytest.mark.parametrize("end", ["= [1,", "= [= 1", "= { a = , }", "= [}", '= "'])
def test_places_come_to_an_end_in_whatever_is_no_toml(end: str) -> None:
    assert places_in(f"a = 1\nb {end}\nc = 2\n").of(("a",)) == (1, 5)


def test_all_faults_come_at_once_those_of_broken_lines_among_them(folder: Path) -> None:
    text = WHOLE
    for old, new in (
        ("stable = 0.5", "stable = 0,5"),
        ("modulo = true", "modulo = Yes"),
        ('"EXX"', '"EXQ"'),
        ("[axes.table]", "[axes.tabel]"),
        ('"COM5"', '"COM"'),
    ):
        text = text.replace(old, new, 1)
    found = check_site(written(folder, text))
    assert [fault.line for fault in found.faults] == [17, 32, 35, 37, 46]


@pytest.mark.parametrize("change", [lambda text: b"\xef\xbb\xbf" + text, lambda text: text.replace(b"\n", b"\r\n")])
def test_marks_and_line_ends_of_windows_are_read(folder: Path, change: object) -> None:
    path = written(folder, change(WHOLE.encode()))  # type: ignore[operator]
    assert check_site(path).faults == ()
    assert load_site(path).site.name == "grinder-7"


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (WHOLE.encode("utf-16"), "UTF-16"),
        (WHOLE.encode("utf-16-le"), "UTF-16"),
        (b"\x7fELF\x02\x01\x01\0" + WHOLE.encode(), "not a text"),
        (f"# Gerät\n{WHOLE}".encode("latin-1"), "Latin-1 (Windows-1252): byte 0xe4, ä, in line 1, column 6"),
    ],
)
def test_other_encodings_are_named(folder: Path, data: bytes, told: str) -> None:
    with pytest.raises(ConfigError, match="E-CFG-ENCODING") as caught:
        read_site(written(folder, data))
    assert told in caught.value.what


def test_what_is_no_file_or_too_large_is_refused_at_once(folder: Path) -> None:
    large = folder / "large.toml"
    with large.open("wb") as file:
        file.truncate(200_000_000)
    os.mkfifo(folder / "pipe")
    written(folder, WHOLE)
    for name, told in (
        ("large.toml", "1048576"),
        ("pipe", "not a regular file"),
        ("", "folder"),
        ("sit.toml", "site.toml?"),
    ):
        with pytest.raises(ConfigError, match="E-CFG-READ") as caught:
            read_site(folder / name)
        assert told in caught.value.what


def test_files_that_are_named_and_missing_are_told(folder: Path) -> None:
    (folder / "password.txt").unlink()
    (folder / "control.der").write_text("not a certificate")
    (folder / "runs").write_text("a file")
    text = (
        changed("stable = 0.5", 'stable = 0.5\nfile = "x1.rtl"\nfile_datum = 0.0')
        + '[work]\ngear = "gear.toml"\nheight_mm = 0.0\n'
    )
    (folder / "gear.toml").write_text("[gear]\n")
    told = {fault.path[-1]: str(fault.error("f")) for fault in check_site(written(folder, text)).faults}
    assert set(told) == {"password_file", "server_certificate", "file", "gear", "store"}
    (folder / "control.der").unlink()
    found = check_site(written(folder, WHOLE)).faults
    assert [fault.code for fault in found] == ["E-CFG-FILE", "E-CFG-FILE", "E-CFG-CERTIFICATE"]
    assert "trueflank doctor certificate" in found[-1].error("f").hint


def test_an_overrun_beyond_the_travel_is_a_doubt_that_keeps_nobody_from_other_commands(folder: Path) -> None:
    for text, old, new in (
        (WHOLE, "[-420.0, 20.0]", "[-402.0, 20.0]"),
        ((EXAMPLES / "files-only.toml").read_text(encoding="utf-8"), "[-420.0, 20.0]", "[-417.0, 20.0]"),
    ):
        assert old in text
        found = check_site(written(folder, text.replace(old, new)))
        assert found.faults == ()
        assert any("reverses at -" in one.error("f").what for one in found.doubts)


@pytest.mark.parametrize(
    ("line", "key", "told"),
    [
        ('wheel_place = "R80"', "wheel_place", "R80, which the programs use themselves"),
        ('wheel_place = "R99"', "wheel_place", "R99, which the programs use themselves"),
        (
            'wheel_place = "R9999999"',
            "wheel_place",
            "wheel_place = R9999999 of the test part is not a number from R0",
        ),
        ('wheel_on = "S1500 M3"', "work", "does not stop"),
        ('wheel_on = "S1500 M3"\nwheel_off = "M3"', "wheel_off", "does not stop"),
        ('wheel_on = "S1500 M3"\nwheel_off = "M9"', "wheel_off", "does not stop"),
        ('wheel_on = "S2=1500 M2=4"\nwheel_off = "M1=5"', "wheel_off", "does not stop"),
        ('wheel_off = "S1500 M03"', "wheel_off", "does not stop"),
    ],
)
def test_what_no_grinding_program_can_have_is_refused_as_by_the_program(
    folder: Path, line: str, key: str, told: str
) -> None:
    shutil.copy(GEAR, folder / "gear.toml")
    stroke = STROKE.replace("AT", str([*range(0, 301, 20)]))
    whole = WHOLE.replace("[[setups]]", f"{stroke}\n[[setups]]") + WORK
    assert check_site(written(folder, whole)).faults == ()
    path = written(folder, whole + line + "\n")
    found = check_site(path).faults
    assert [(fault.path[-1], told in fault.error("f").what) for fault in found] == [(key, True)]
    made = CliRunner().invoke(app, ["check", "programs", str(path), "--what", "grind", "-o", str(folder / "programs")])
    assert isinstance(made.exception, ConfigError)
    assert told in made.exception.what


@pytest.mark.parametrize(
    "line",
    [
        'wheel_place = "R200"',
        'wheel_on = "S1500 M3 M8"\nwheel_off = "M05 M9"',
        'wheel_on = "S1=1500 M1=3"\nwheel_off = "M5"',
        'wheel_on = "S1500 M3"\nwheel_off = "M1=5"',
        'wheel_on = "H7"\nwheel_off = "H8"',
        'wheel_off = "M9"',
    ],
)
def test_what_a_grinding_program_can_have_is_not_refused(folder: Path, line: str) -> None:
    shutil.copy(GEAR, folder / "gear.toml")
    stroke = STROKE.replace("AT", str([*range(0, 301, 20)]))
    found = check_site(written(folder, WHOLE.replace("[[setups]]", f"{stroke}\n[[setups]]") + WORK + line + "\n"))
    assert found.faults == ()


@pytest.mark.parametrize(
    ("right", "wrong", "path", "told"),
    [
        ("travel = [0.0, 360.0]", "travel = [0.0, 6.283]", ("axes", 1, "travel"), "turns without end"),
        ("[site]\n", "[site]\napprovals = true\n", ("site", "approvals"), "1 or 2"),
        ('component = "EXX"', 'component = "EXX"\nbeam = true', ("axes", 0, "measure", "beam"), "1 or -1"),
        ('letter = "X"', 'letter = "\N{GREEK CAPITAL LETTER CHI}"', ("axes", 0, "letter"), "other alphabets"),
    ],
)
def test_what_only_looks_right_is_a_fault(
    folder: Path, right: str, wrong: str, path: tuple[str | int, ...], told: str
) -> None:
    (found,) = check_site(written(folder, changed(right, wrong))).faults
    assert found.path == path
    assert told in found.error("f").what


@pytest.mark.parametrize("store", ["~/runs", "$HOME/runs", "%TEMP%/runs"])
def test_what_only_a_shell_would_replace_in_a_path_is_doubted(folder: Path, store: str) -> None:
    found = check_site(written(folder, changed("[site]\n", f'[site]\nstore = "{store}"\n')))
    assert [one.path for one in found.doubts] == [("site", "store")]


def test_a_refused_name_is_told_once_and_not_again_by_all_that_name_it(tmp_path: Path) -> None:
    """Whoever used it may have meant it: "did you mean Z1" would lead astray."""
    text = (GEAR.parents[1] / "sites" / "opcua-grinder.toml").read_text(encoding="utf-8")
    for right, wrong, path in (
        ('name = "X1" ', 'name = "\N{CYRILLIC CAPITAL LETTER HA}1" ', ("axes", 0, "name")),
        ('name = "laser"', 'name = "la\N{ZERO WIDTH SPACE}ser"', ("instruments", 0, "name")),
    ):
        reading = read_site(written(tmp_path, text.replace(right, wrong, 1)))
        assert [one.path for one in (*reading.faults, *reading.doubts)] == [path]


def test_a_cure_that_several_faults_share_stands_once(folder: Path) -> None:
    path = written(folder, changed('"EXX"', '"EXQ"').replace("feed = 900.0", "feed = 0.0"))
    assert CliRunner().invoke(app, ["check", str(path)]).output.count("correct the value") == 1


def test_the_command_tells_people_and_programs(folder: Path) -> None:
    path = written(folder, changed('"EXX"', '"EXQ"').replace("feed = 900.0", "feed = 0.0"))
    shown = CliRunner().invoke(app, ["check", str(path)])
    assert shown.exit_code == 2
    assert f"{path}:32:13: E-CFG-VALUE" in shown.output
    data = json.loads(CliRunner().invoke(app, ["check", str(path), "--json"]).output)
    assert [(one["line"], one["column"], one["code"]) for one in data["faults"]] == [
        (32, 13, "E-CFG-VALUE"),
        (53, 8, "E-CFG-VALUE"),
    ]
    assert data["valid"] is False
    good = CliRunner().invoke(app, ["check", str(written(folder, WHOLE))])
    assert (good.exit_code, "valid" in good.output) == (0, True)


def test_places_are_found_in_every_form_of_toml() -> None:
    text = 'a.b = 1\n"c d" = { e = [1,\n 2], f = """x\n]""" } # = 3\n[[g]]\nh = \'x\'\n[g.i]\nj = 2\n[[g]]\nh = 3\n'
    places = places_in(text)
    found = {
        path: places.of(path) for path in (("a", "b"), ("c d", "e", 1), ("c d", "f"), ("g", 0, "i", "j"), ("g", 1, "h"))
    }
    assert list(found.values()) == [(1, 7), (3, 2), (3, 10), (8, 5), (10, 5)]
    assert places.of(("g", 0, "i"), key=True) == (7, 1)


@pytest.mark.parametrize(
    ("name", "right", "wrong", "path"),
    [
        ("five-axes", '"COM5"', '"COM5 "', ("instruments", 0, "url")),
        ("carried-grinder", 'folder = "carried"', 'folder = ""', ("controller", "settings", "folder")),
    ],
)
def test_slips_that_cannot_be_seen_in_an_editor_are_found(
    tmp_path: Path, name: str, right: str, wrong: str, path: tuple[str | int, ...]
) -> None:
    text = (GEAR.parents[1] / "sites" / f"{name}.toml").read_text(encoding="utf-8")
    site = tmp_path / "site.toml"
    site.write_text(text.replace(right, wrong), encoding="utf-8")
    (found,) = [one for one in check_site(site).faults if one.path == path]
    assert (found.line, found.column) > (1, 1)


def test_a_plan_of_typed_readings_names_the_rotary_axis_they_cannot_measure(tmp_path: Path) -> None:
    text = (GEAR.parents[1] / "sites" / "mailbox-grinder.toml").read_text(encoding="utf-8")
    site = tmp_path / "site.toml"
    site.write_text(text.replace('instrument = "calibrator"', 'instrument = "laser"'), encoding="utf-8")
    planned = CliRunner().invoke(app, ["run", str(site), "--plan"])
    assert "W-CFG-TYPED-ROTARY: C1" in planned.output


def test_typed_readings_of_a_rotary_axis_are_doubted_where_a_run_is_meant(tmp_path: Path) -> None:
    text = (GEAR.parents[1] / "sites" / "mailbox-grinder.toml").read_text(encoding="utf-8")
    site = tmp_path / "site.toml"
    site.write_text(text.replace('instrument = "calibrator"', 'instrument = "laser"'), encoding="utf-8")
    (doubt,) = check_site(site).doubts
    assert doubt.path == ("axes", 2, "measure", "instrument")
    assert "typed readings" in str(doubt.fields)
    planned = CliRunner().invoke(app, ["run", str(GEAR.parents[1] / "sites" / "files-only.toml"), "--plan"])
    assert getattr(planned.exception, "code", "") == "E-FILES-ONLY"
    assert "rotary (typed)" not in planned.output


@pytest.mark.parametrize("place", ["X1 = [-400.0, 0.0]", ""])
def test_who_brings_files_is_asked_for_no_place_to_push_from(tmp_path: Path, place: str) -> None:
    text = (GEAR.parents[1] / "sites" / "files-only.toml").read_text(encoding="utf-8")
    site = tmp_path / "site.toml"
    site.write_text(re.sub(r"^safe = .*$", f"safe = {{ {place} }}", text, flags=re.MULTILINE), encoding="utf-8")
    assert [one.code for one in (*check_site(site).faults, *check_site(site).doubts)] == []


def test_a_carried_control_is_not_waited_for_and_the_next_step_is_one_that_it_knows(tmp_path: Path) -> None:
    """What must be carried is written and said; the files of who has no control go on with a day's folder."""
    for name, step in (("carried-grinder", "doctor self-test"), ("files-only", "day FOLDER --site")):
        site = Path(shutil.copy(GEAR.parents[1] / "sites" / f"{name}.toml", tmp_path))
        found = CliRunner().invoke(app, ["check", str(site)])
        assert f"next: trueflank {step} {site}" in found.output
    site = tmp_path / "carried-grinder.toml"
    told = CliRunner().invoke(app, ["doctor", "devices", str(site)])
    assert isinstance(told.exception, TrueflankError)
    assert (told.exception.code, told.exception.exit_code) == ("E-OFF-CARRY", 15)
    assert "TFSEE" in (tmp_path / "carried" / "carry" / "SHEET.txt").read_text()


@pytest.mark.parametrize("command", [["doctor", "self-test"], ["tables", "verify"], ["rollback"]])
def test_a_site_of_files_only_is_left_without_an_empty_run(tmp_path: Path, command: list[str]) -> None:
    site = tmp_path / "site.toml"
    site.write_bytes((GEAR.parents[1] / "sites" / "files-only.toml").read_bytes())
    done = CliRunner().invoke(app, [*command, str(site)])
    assert isinstance(done.exception, ConfigError)
    assert done.exception.code == "E-FILES-ONLY"
    assert [one.name for one in tmp_path.glob("runs/*") if (one / "run.json").exists()] == []
    assert not (tmp_path / "runs").exists() or list((tmp_path / "runs").iterdir()) == []
