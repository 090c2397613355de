"""Damaged table texts: our error with line and reason, or what their own canonical rewrite means. Nothing else."""

from __future__ import annotations

import random
from collections import Counter
from time import process_time

import pytest

from drivers.errors import FileFormatError, Gap, TrueflankError
from drivers.sinumerik.tablefile import reader, writer
from drivers.sinumerik.tablefile.format import TableFiles
from drivers.tablefile import TableFile
from tests.sizes import few

INPUTS = 100_000
SHARDS = 40
MOST = 20.0  # times what an undamaged text takes in the same run; one with all its lines refused takes a few

EEC = (
    "%_N_AX_EEC_INI\nCHANDATA(1)\n$AA_ENC_COMP[0,0,X1]=0.003 ; first\n$AA_ENC_COMP[0,1,X1]=-0.0\n"
    "$AA_ENC_COMP_STEP[0,X1]=1.0\n$AA_ENC_COMP_MIN[0,X1]=-200.0\n$AA_ENC_COMP_MAX[0,X1]=-199.0\nM17\n",
    "%_N_AX4_EEC_INI\nN10 $AA_ENC_COMP_STEP[0,AX4]=180 '1A2B\nN20 $AA_ENC_COMP_MIN [0, AX4] = 0 '1A2C\n"
    "N30 $AA_ENC_COMP_MAX[0,AX4]=360 '1A2D\nN40 $AA_ENC_COMP_IS_MODULO[0,AX4]=1 '1A2E\n"
    "N50 $aa_enc_comp[0,0,ax4]=+.001 '1A2F\nN60 $AA_ENC_COMP[0,1,AX4]=12EX-4 '1A30\n$AA_ENC_COMP[0,2,AX4]=.001\nM30\n",
    "%_N_T_SPF\n;$PATH=/_N_SPF_DIR\n$AA_ENC_COMP[1,0,C1]=0\n$AA_ENC_COMP[1,1,C1]=0.0004\n"
    "$AA_ENC_COMP_MIN[1,C1]=0\n$AA_ENC_COMP_MAX[1,C1]=7.5\n$AA_ENC_COMP_STEP[1,C1]=7.5\nm0\nM17",
)
CEC = (
    "$AN_CEC[0,0]=0.0\n$AN_CEC[0,1]=0.002\n$AN_CEC_INPUT_AXIS[0]=(X1)\n$AN_CEC_OUTPUT_AXIS[0]=(X1)\n"
    "$AN_CEC_STEP[0]=58.0\n$AN_CEC_MIN[0]=-63\n$AN_CEC_MAX[0]=-5.0\n$AN_CEC_DIRECTION[0]=-1\nM0\nM17\n",
    '%_N_NC_CEC_INI\nCHANDATA(1)\n$AN_CEC_INPUT_AXIS[2]="AX4"\n$AN_CEC_OUTPUT_AXIS[2]=Z1\n$AN_CEC_STEP[2]=180\n'
    "$AN_CEC_MIN[2]=0\n$AN_CEC_MAX[2]=360\n$AN_CEC_IS_MODULO[2]=TRUE\n$AN_CEC_TYPE[2]=1\n$AN_CEC_MULT_BY_TABLE[2]=1\n"
    "$AN_CEC[2,0]=0\n$AN_CEC[2,1]=.5EX-2\n$AN_CEC[2,2]=0\n$AN_CEC_INPUT_NCU[2]=1\nM17\n",
)
SETTINGS = (
    "N32450 $MA_BACKLASH[0,AX1]=0.004 '1a2b\nN32452 $MA_BACKLASH_FACTOR[1,AX1]=0.5\n"
    "N32454 $MA_BACKLASH_MODE[0,AX1]='H3'\n$MA_BACKLASH_DYN[0,AX1]=-.001\n"
    "$MA_BACKLASH_DYN_MAX_VELO[AX1]=1\n$MA_ENC_COMP_ENABLE[0,AX1]=TRUE\nM17\n",
    "%_N_T_INI\n$MA_TEMP_COMP_TYPE[Z1]=3\n$SA_TEMP_COMP_ABS_VALUE[Z1]=0.01\n$SA_TEMP_COMP_SLOPE[Z1]=1.15EX-5\n"
    "$SA_TEMP_COMP_REF_POSITION[Z1]=-100.25\n$MA_COMP_ADD_VELO_FACTOR[Z1]=0.01\n$SN_CEC_TABLE_WEIGHT[0]=1\nM17\n",
)
KINDS = [form for name, form in writer.FORMS.items() if name != "axis-ini"]
FORMATS = {"eec": EEC, "cec": CEC, "settings": SETTINGS}
MARKS = (
    "0 1 2 9 . , - + = [ ] ( ) $ _ N X ; % ' \" \t # \x00 \x85 \u00e4 \u0661 \ufeff 1EX9 1e3 NaN inf TRUE AX 'H1' "
    "M17 M0 %_N_AX_EEC_INI ;$PATH=/_N_MPF_DIR CHANDATA(1) 99999999 0.00000000001 1EX-99 -0.0 360 \r \n"
)
NUMBERS = "0 1 2 0.5 -0.001 7.5 360 -200 100 1EX-2 TRUE FALSE (AX1) -1 12.3456789012 99999 0.00000000004 +3 .25 5"
PIECES, VALUES = MARKS.split(" "), NUMBERS.split()


def mutated(text: str, chance: random.Random) -> str:
    """One to three changes: a piece put in, taken out or exchanged; a value set; a line dropped, doubled, moved."""
    for _ in range(1 + int(chance.random() * 2.5)):
        size = len(text)
        place = int(chance.random() * (size + 1))
        act = chance.random()
        if act < 0.2:
            sign = text.find("=", place)
            end = text.find("\n", sign)
            text = text[: sign + 1] + VALUES[int(chance.random() * len(VALUES))] + text[end:]
        elif act < 0.4:
            text = text[:place] + PIECES[int(chance.random() * len(PIECES))] + text[place:]
        elif act < 0.55:
            text = text[:place] + text[place + 1 + int(chance.random() * 3) :]
        elif act < 0.75:
            text = text[:place] + PIECES[int(chance.random() * len(PIECES))] + text[place + 1 :]
        else:
            lines = text.split("\n")
            one, two = int(chance.random() * len(lines)), int(chance.random() * len(lines))
            if act < 0.85:
                lines[one], lines[two] = lines[two], lines[one]
            elif act < 0.93:
                lines.insert(one, lines[two])
            else:
                del lines[one]
            text = "\n".join(lines)
    return text


def outcome(text: str) -> TableFile | TrueflankError:
    try:
        return reader.read_tables(text, "mutated")
    except TrueflankError as error:
        return error


def check_refusal(error: TrueflankError, text: str) -> None:
    """Our own error, in words, with a line that the text has."""
    assert isinstance(error, FileFormatError | Gap), text
    line = error.fields["line"]
    assert isinstance(line, int), text
    assert 1 <= line <= max(len(text.splitlines()), 1), text
    assert error.code.startswith("E-TABLE-"), text
    assert f"line {line}" in str(error), str(error)
    assert error.hint, text
    assert "<" not in error.what.replace(str(error.fields.get("text")), ""), str(error)


def least(text: str) -> float:
    """Seconds of the processor that a text takes at least: what else happens to a process only ever adds."""
    times = []
    for _ in range(5):
        start = process_time()
        outcome(text)
        times.append(process_time() - start)
    return min(times)


def fuzz(name: str, seed: int, count: int) -> Counter[str]:
    """Mutate, read, check. Counts what was accepted and every reason for refusal."""
    chance, texts, counts = random.Random(f"{name}-{seed}"), FORMATS[name], Counter[str]()
    slowest, longest, files = "", 0.0, TableFiles()
    for number in range(count):
        text = mutated(texts[number % len(texts)], chance)
        start = process_time()  # our own work alone: what else the machine does must not count
        found = outcome(text)
        took = process_time() - start
        slowest, longest = (text, took) if took > longest else (slowest, longest)
        if isinstance(found, TableFile):
            counts["accepted"] += 1
            form = KINDS[int(chance.random() * len(KINDS))]
            again = writer.render_file(found, form)
            reread = reader.read_tables(again, "again")
            assert reread == found, text
            assert writer.render_file(reread, form) == again, text
        else:
            counts[found.code] += 1
            check_refusal(found, text)
        if number % 20 == 0:
            assert all(str(one.error) for one in files.findings(text, "mutated")), text
    floor = max(least(text) for text in texts)
    assert least(slowest) < MOST * floor, f"{least(slowest) / floor:.0f} times as long as an undamaged text: {slowest}"
    print(f"{name}, seed {seed}: {counts['accepted']} of {count} mutated texts accepted; {dict(counts)}")
    return counts


@pytest.mark.parametrize("seed", few(range(SHARDS), more=5))
@pytest.mark.parametrize("name", sorted(FORMATS))
def test_mutated_texts_are_refused_with_line_and_reason_or_mean_their_rewrite(name: str, seed: int) -> None:
    counts = fuzz(name, seed, INPUTS // SHARDS)
    refusals = [code for code in counts if code != "accepted"]
    assert 0.05 < counts["accepted"] / counts.total() < 0.95, f"{counts['accepted']} accepted of {counts.total()}"
    assert len(refusals) >= 8, counts


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(100, 100 + 10 * SHARDS))
@pytest.mark.parametrize("name", sorted(FORMATS))
def test_ten_times_as_many_mutated_texts(name: str, seed: int) -> None:
    counts = fuzz(name, seed, INPUTS // SHARDS)
    assert counts["accepted"] > 0, counts
    assert counts["accepted"] < counts.total(), counts
