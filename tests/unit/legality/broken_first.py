"""Blocks that break a rule, to be put into the working part of a program: rules A to M."""

from __future__ import annotations

FIRST: dict[str, tuple[str, ...]] = {
    "E-LEGAL-ASSIGN": (
        *("X R5", "F R14", "X", "SPOS 90", "FA[X] 100", "R5", "AX3 10", "L", "R5 10", "$AN_CEC[0,0] 5"),
        *("Z ABS(R1)", "POS[X]", "ACC[X] 50", "$AN_CEC[0,0]"),
    ),
    "E-LEGAL-BLOCK-NUMBER": (
        *("N123456789 R1=1", "R1=1 N10", "N10 N20 R1=1", "N1.5 R1=1", ":1.5 R1=1", "G1 N5 X10", ":ABC R1=1"),
        *("/10 R1=1", "M3 N7", "N10.0 G0 X0", "N999999999 M3", "STOPRE N20"),
    ),
    "E-LEGAL-BRACKET": (
        *("R1=(2+3", "R1=2+3)", "R1=(2+3]", "R1=[2+3)", 'MSG("a"', "IF (R1==1 GOTOF NOWHERE", "R1=SIN(30", "R[1=5"),
        *("$AN_CEC[0,1=2", "R1=((2)", "R1=(2))", 'WRITE(R1,"_N_A_SPF","x"', "POS[X=10", "R1=)2("),
    ),
    "E-LEGAL-BRACKET-DEPTH": tuple(f"R{n}={'(' * n}1{')' * n}" for n in range(41, 53)),
    "E-LEGAL-CHARACTER": (
        *("R1=2^3", "R1=5 # five", "R1?", "R1=2!", "@R1=3", "R1={1}", "MÜLLER=1", "R1=R2|R3", "R1=~R2", "R1=R2%3"),
        *("R1=R2\\3", 'MSG("5 → 6")', "%_N_ELSE_MPF", "R1=5 µ"),
    ),
    "E-LEGAL-CLOSE": (
        *("ENDIF", "ENDFOR", "ENDWHILE", "ENDLOOP", "UNTIL R1>3", "N10 ENDIF", "endif", "UNTIL (R1==1) OR (R2==2)"),
        *("IF R1==1\nENDFOR\nENDIF", "ENDLOOP ; stray", "  ENDFOR", "N20 ENDWHILE"),
    ),
    "E-LEGAL-COMPARISON": (
        *("IF $AN_CEC_INPUT_AXIS[0]<(X1) GOTOC NOWHERE", 'IF "A">"B" GOTOC NOWHERE', 'R1=("A"==1)'),
        *("IF $P_AXN1==1 GOTOC NOWHERE", 'IF (X1)=="X1" GOTOC NOWHERE', "R1=((X1)>=(Y1))", 'R1=("A"<>$P_AXN1)'),
        *('WHILE "A"<="B"\nENDWHILE', 'R1=(R2=="2")', "R1=($AN_CEC_OUTPUT_AXIS[1]==2)"),
        *("R1=(AXSTRING(X1)==(X1))", 'R1=(AXNAME("X1")=="X1")'),
    ),
    "E-LEGAL-DIRECTION": (
        *(f"ULA{n}:\nGOTOF ULA{n}" for n in range(4)),
        *(f"GOTOB ULB{n}\nULB{n}:" for n in range(4)),
        *(f"IF R1>{n} GOTOB ULC{n}\nR1=1\nULC{n}: R2=2" for n in range(2)),
        *(f"N{n} R1=1\nIF R1>{n} GOTOF N{n}" for n in range(900, 903)),
    ),
    "E-LEGAL-ELSE": (
        *("ELSE", "IF R1==1\nELSE\nELSE\nENDIF", "LOOP\nELSE\nENDLOOP", "IF R1==1\nLOOP\nELSE\nENDLOOP\nENDIF"),
        *("FOR R1=0 TO 3\nELSE\nENDFOR", "N10 ELSE", "REPEAT\nELSE\nUNTIL R1>2", "WHILE R1<2\nELSE\nENDWHILE"),
        *("else", "IF R1==1 GOTOC NOWHERE\nELSE", "IF R1==1\nENDIF\nELSE", "ELSE ; stray"),
    ),
    "E-LEGAL-FILE-NAME": (
        *('DELETE(R1,"_N_TF BACK_SPF")', 'DELETE(R1,"_N_1BACK_SPF")', 'DELETE(R1,"_N_TF-BACK_SPF")', 'DELETE(R1,"")'),
        *('WRITE(R1,"_N_SPF_DIR/_N_TFBACK_SPF","x")', 'WRITE(R1,"/SPF/_N_TFBACK_SPF","x")', 'R2=ISFILE("C:\\\\X")'),
        *('READ(R1,"_N_TF.BACK_SPF",1,1,R2)', 'R2=ISFILE("/_N_SPF_DIR/")', 'WRITE(R1,"TFBACK.TXT","x")'),
        *('DELETE(R1,"/_N_SPF_DIR//_N_TFBACK_SPF")', 'DELETE(R1,"T")', 'WRITE(R1,"_N__1_SPF","x")'),
    ),
    "E-LEGAL-G-GROUP": (
        *("G0 G1 X10", "G90 G91", "G17 G18", "G40 G41", "G500 G54", "G60 G64", "G601 G602", "G70 G710", "G94 G95"),
        *("DIAMON DIAMOF", "SUPA G153 X10", "G1 G17 X10 G3", "FFWON FFWOF", "BRISK SOFT", "G01 G00 X1", "G54 G505"),
    ),
    "E-LEGAL-G-UNKNOWN": (*(f"G{n} X10" for n in (6, 8, 20, 21, 43, 49, 61, 80, 98, 999, 1000)), "G1.5 X1"),
    "E-LEGAL-INDEX-AXIS": (
        *("$MA_ENC_COMP_ENABLE[0,1]=0", "$MA_BACKLASH[0,0]=1", "$MA_CEC_ENABLE[1]=1", "$AA_ENC_COMP[0,1,2]=0"),
        *("$AA_ENC_COMP_STEP[0,1]=5", "R1=$AA_IM[1]", "R1=$VA_IM[2]", "R1=$VA_CEC_COMP_VAL[0]", "$MA_CEC_ENABLE[R1]=1"),
        *('$MA_CEC_ENABLE["X1"]=1', "R1=$AA_ENC_COMP_MAX[0,R2]", "$AA_ENC_COMP[0,X1,1]=0"),
    ),
    "E-LEGAL-INDEX-NUMBER": (
        *("$AN_CEC[X1,0]=0", "$AN_CEC[0,X1]=0", "$AN_CEC_MAX[X1]=1", "$AA_ENC_COMP[X1,0,X1]=0", "R[X1]=5"),
        *("$SN_CEC_TABLE_ENABLE[AX1]=1", "$AA_ENC_COMP[0,X1,X1]=0", "R1=$MN_MM_CEC_MAX_POINTS[X1]", 'R["1"]=5'),
        *('$AN_CEC["0",0]=1', "$MA_BACKLASH[X1,X1]=0", "$AA_ENC_COMP_MIN[AX1,X1]=0"),
    ),
    "E-LEGAL-INDEX-VALUE": (
        *("$AN_CEC[0,-1]=0", "$AN_CEC[0,1.5]=0", "R[-1]=5", "R[1.5]=5", "$AA_ENC_COMP[-1,0,X1]=0", "R1=R[-2]"),
        *("$SN_CEC_TABLE_ENABLE[-1]=1", "$MA_BACKLASH[0.5,X1]=0", "R1=$AN_CEC[1.0,0]", "$AA_ENC_COMP[0,1EX1,X1]=0"),
        *("R1=$AN_CEC_STEP[-3]", "R[0.1]=1"),
    ),
    "E-LEGAL-INDICES": (
        *("$AN_CEC[0]=0", "$AN_CEC=0", "$AN_CEC[0,1,2]=0", "$MA_BACKLASH[X1]=0", "$MA_CEC_ENABLE[0,X1]=1", "R[1,2]=3"),
        *("$AA_ENC_COMP[0,X1]=0", "$SN_CEC_TABLE_ENABLE=1", "$SN_CEC_TABLE_ENABLE[0,X1]=1", "R1=$AA_IM"),
        *("$MN_LEN_PROTOCOL_FILE[0]=9", "R1=$AN_CEC_TYPE", "R1=$MA_ENC_COMP_ENABLE[X1]"),
    ),
    "E-LEGAL-INTO": (
        *(
            f"{word} UIN{n}\n{opener}\nR2=2\nUIN{n}:\n{closer}"
            for n, (word, opener, closer) in enumerate(
                (word, *pair)
                for word in ("GOTOF", "GOTO", "IF R1==1 GOTOF")
                for pair in (
                    ("IF R1==1", "ENDIF"),
                    ("LOOP", "ENDLOOP"),
                    ("FOR R1=0 TO 3", "ENDFOR"),
                    ("REPEAT", "UNTIL R1>3"),
                )
            )
        ),
    ),
    "E-LEGAL-LABEL": (
        *("GOTOF UNOWHERE", "GOTOB UNOWHERE", "GOTO UNOWHERE", "IF R1==1 GOTOF UNOWHERE", "GOTOF N987", "GOTO :98"),
        *("CASE R1 OF 1 GOTOF UNOWHERE", "IF R1==1 GOTOF UNOWHERE IF R1==2 GOTOC UELSE", "REPEAT UNOWHERE P=2"),
        *("CASE R1 OF 1 GOTOC UA DEFAULT GOTOB UNOWHERE", "REPEATB UNOWHERE", "GOTOB M30", "gotof unowhere"),
    ),
    "E-LEGAL-LABELLED": (
        *(
            f"ULB{n}: {opener}\n{closer}"
            for n, (opener, closer) in enumerate(
                (("IF R1==1", "ENDIF"), ("LOOP", "ENDLOOP"), ("FOR R1=0 TO 3", "ENDFOR"), ("WHILE R1<3", "ENDWHILE"))
            )
        ),
        *(f"N{n} ULC{n}: REPEAT\nUNTIL R1>3" for n in range(5)),
        *(f"ULD{n}: IF R1==1\nELSE\nENDIF" for n in range(3)),
    ),
    "E-LEGAL-LATE": (
        *(
            "DEF INT UNEW",
            "DEF REAL UNEW=1.5",
            "DEF BOOL UNEW,UOLD",
            "DEF STRING[5] UNEW",
            "DEF AXIS UNEW",
            "DEF INT UNEW[5]",
        ),
        *(
            "N10 DEF INT UNEW",
            "EXTERN UNEW(INT)",
            "DEFINE UNEW AS M30",
            "DEF CHAR UNEW",
            "DEF FRAME UNEW",
            "def int unew",
        ),
    ),
    "E-LEGAL-LENGTH": tuple(f"R{n}={n} ;{'-' * (506 + n)}" for n in range(4, 17)),
    "E-LEGAL-MSG": tuple(f'MSG("{"a" * (125 - n)}"<<R{n}<<"{"b" * n}")' for n in range(1, 13)),
}
