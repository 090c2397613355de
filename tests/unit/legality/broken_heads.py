"""Blocks that break a rule of a program's head, to be put before everything else."""

from __future__ import annotations

HEADS: dict[str, tuple[str, ...]] = {
    "E-LEGAL-DEF-TYPE": (
        *(
            "DEF UA1",
            "DEF INTEGER UA1",
            "DEF FLOAT UA1",
            "DEF DOUBLE UA1",
            "DEF",
            "DEF NCK UA1",
            "DEF BOOLEAN UA1",
            "DEF VAR UA1",
        ),
        *("DEF 5 UA1", "DEF UINT=5", "DEF WORD UA1", "DEF SYNR UA1"),
    ),
    "E-LEGAL-INDEX-VALUE": tuple(
        f"DEF INT UA1[{size}]" for size in ("0", "1.5", "-1", "X", "2,0", "1,2,3,4", "", "R1", "5,", "UX")
    ),
    "E-LEGAL-INTEGER": tuple(
        f"DEF INT UA1={value}"
        for value in (
            *("2147483648", "-2147483649", "3000000000", "9999999999", "12345678901", "-5000000000"),
            *("4294967296", "2147483650", "99999999999999999999999", "-2147483650"),
        )
    ),
    "E-LEGAL-NAME": (
        *(f"DEF INT {name}" for name in ("N", "K", "I", "P", "X", "R5", "X1", "G1", "A2B", "H", "T1_A", "M30")),
        *("DEF REAL UA1, N", "DEF STRING[5] S", "DEFINE N AS M30"),
    ),
    "E-LEGAL-NAME-LENGTH": tuple(f"DEF INT U{'A' * n}" for n in range(31, 42)),
    "E-LEGAL-PREFIX": tuple(
        f"DEF INT {name}"
        for name in (
            "CYCLE_A",
            "CYCLE5",
            "_UA",
            "CCSA",
            "CC_A",
            "CUST_A",
            "GROUP_A",
            "S_A",
            "E_A",
            "F_A",
            "CYCLES",
            "__A",
        )
    ),
    "E-LEGAL-RESERVED": tuple(
        f"DEF INT {name}"
        for name in (
            "SIN",
            "ENDIF",
            "STOPRE",
            "TRUE",
            "SUPA",
            "MSG",
            "AND",
            "DIV",
            "REAL",
            "SPOS",
            "RL",
            "AX1",
            "CYCLE800",
            "PROC",
        )
    ),
    "E-LEGAL-STRING-FULL": tuple(f'DEF STRING[{n}] UA1="{"x" * (n + 1)}"' for n in range(1, 13)),
    "E-LEGAL-STRING-LENGTH": tuple(
        f"DEF STRING[{n}] UA1" for n in (0, 201, 202, 250, 255, 256, 300, 500, 1000, 99999, "N", 1.5)
    ),
    "E-LEGAL-SYNTAX": (
        *(
            "DEF INT UA1 UA2",
            "DEF INT UA1,",
            "DEF INT UA1=",
            "DEF STRING UA1",
            "DEF INT UA1=5 UA2=6",
            "DEF INT UA1+UA2",
        ),
        *(
            "DEF INT UA1=5,,UA2",
            "DEF REAL UA1(5)",
            "DEF INT UA1 REAL UA2",
            "DEF INT UA1=2+",
            "DEFINE UA1 M30",
            "DEF INT UA1:UA2",
        ),
    ),
    "E-LEGAL-TWICE": (
        *(f"DEF INT UA{n}, UB, UA{n}" for n in range(4)),
        *(f"DEF INT UA{n}\nDEF REAL UA{n}" for n in range(4)),
        *(f"DEF BOOL UA{n}, ua{n}" for n in range(4)),
    ),
    "E-LEGAL-TYPE": (
        *(
            'DEF INT UA1="A"',
            "DEF REAL UA1=(X1)",
            "DEF STRING[5] UA1=5",
            "DEF AXIS UA1=1",
            'DEF AXIS UA1="X1"',
            "DEF STRING[5] UA1=(X1)",
        ),
        *(
            'DEF REAL UA1="1.5"',
            "DEF INT UA1=(Y1)",
            "DEF STRING[9] UA1=1.5",
            "DEF AXIS UA1=TRUE",
            "DEF STRING[9] UA1=2+3",
        ),
    ),
    "E-LEGAL-LIST": (
        "DEF REAL UL[3]\nUL[0]=SET(1,2,3,4)",
        "DEF REAL UL[3]\nUL[1]=SET(1,2,3)",
        "DEF REAL UL[3]\nUL[2]=SET(1,2)",
        "DEF INT UL[1]\nUL[0]=SET(1,2)",
        "DEF INT UL[2,2]\nUL[0,0]=SET(1,2,3,4,5)",
        "DEF INT UL[2,2]\nUL[0,1]=SET(1,2,3,4)",
        "DEF INT UL[2,2]\nUL[1,0]=SET(1,2,3)",
        "DEF INT UL[2,2]\nUL[1,1]=SET(1,2)",
        "DEF BOOL UL[2]\nUL[0]=SET(TRUE,FALSE,TRUE)",
        "DEF REAL UL[2]\nUL[1]=SET(1.5,2.5)",
        "DEF REAL UL[4,2]\nUL[3,1]=SET(0.1,0.2)",
    ),
    "E-LEGAL-FOR": tuple(
        f"DEF {kind} UA1\nFOR UA1={first} TO 3\nENDFOR"
        for kind in ("BOOL", "STRING[5]", "AXIS", "CHAR", "FRAME")
        for first in (0, 1)
    ),
    "E-LEGAL-PATH": (
        *(";$PATH=/_N_MPF_DIR", " ;$PATH=/_N_MPF_DIR", "; c\n;$PATH=/_N_MPF_DIR", "%_N_AB_MPF\n ;$PATH=/_N_MPF_DIR"),
        *(
            "%_N_AB_MPF\n;$PATH=_N_MPF_DIR",
            "%_N_AB_MPF\n;$PATH=/MPF",
            "%_N_AB_MPF\n;$PATH=",
            "%_N_AB_MPF\n;$path=/_N_MPF_DIR",
        ),
        *("%_N_AB_MPF\n\n;$PATH=/_N_MPF_DIR", "%_N_AB_MPF\n;$PATH=/_N_MPF_DIR/X", "%_N_AB_MPF\n;$PATH=/_N_M PF_DIR"),
    ),
    "E-LEGAL-HEADER": (
        *(
            "%",
            "%_N_",
            "%AB",
            "%100",
            "% _N_AB_MPF",
            "%_N_AB_MPF M30",
            "%_N_A-B_MPF",
            "%_N_AB.MPF",
            "%_N_AB_MP",
            "%%_N_AB_MPF",
        ),
        *("%MPF100", "%_N_AB_MPF;"),
    ),
    "E-LEGAL-PROGRAM-NAME": tuple(
        f"%_N_{name}_MPF" for name in ("1AB", "A1", "9", "A", "_1", "5_A", "A2B", "_9A", "7AB", "X1")
    ),
    "E-LEGAL-DEVICE-NAME": tuple(
        f"%_N_{name}_MPF" for name in ("CON", "PRN", "AUX", "NUL", "COM1", "COM9", "LPT1", "LPT9", "con", "Com5")
    ),
}
