"""Blocks that break a rule, to be put into the working part of a program: rules N to Z."""

from __future__ import annotations

SECOND: dict[str, tuple[str, ...]] = {
    "E-LEGAL-NUMBER": (
        *("R1=1E5", "R1=1.2.3", "R1=5_000", "R1=0X1F", "R1=1EX", "R1='H3G'", "R1='5'", "R1=1EX400", "X1.2.3", "R1=3MM"),
        *("R1=.", "M1.5", "R1=2.5E-3", "R1='B12'", "R1=1EX-999", "L1.5"),
    ),
    "E-LEGAL-OPERAND": (
        *('R1="A"+"B"', "R1=(X1)+1", 'R1=-"A"', 'R1=NOT "A"', 'R1=2*"3"', 'MSG("axis "<<(X1))', 'R1=("A" AND TRUE)'),
        *(
            "MSG(<<$AN_CEC_INPUT_AXIS[0])",
            "R1=5 DIV $P_AXN1",
            "IF (X1) GOTOC NOWHERE",
            'R1="1" B_OR 2',
            "WHILE (X1)\nENDWHILE",
        ),
    ),
    "E-LEGAL-OPERATOR": (
        *("IF R1=1 GOTOC NOWHERE", "IF R1=>1 GOTOC NOWHERE", "IF R1=<1 GOTOC NOWHERE", "R1==5", "WHILE R1=3\nENDWHILE"),
        *("IF (R1=1) GOTOC NOWHERE", "R1=R2=3", "$AN_CEC[0,0]==5", "REPEAT\nUNTIL R1=3", "IF ABS(R1)=2\nENDIF"),
        *("IF R1=1\nENDIF", "R[5]==2"),
    ),
    "E-LEGAL-PLACE": (
        *("R1=1 ENDIF", "G1 X10 ELSE", "R1=1 FOR R2=0 TO 3", "M3 WHILE R1<3", "R1=2 LOOP", "R1=1 DEF INT UA"),
        *("R1=1 ENDFOR", "STOPRE ENDLOOP", "X10 UNTIL R1>2", "R1=1 REPEAT", "M3 CASE R1 OF 1 GOTOC UA", "G0 PROC UA"),
    ),
    "E-LEGAL-PRIORITY": (
        *("IF R1==1 AND R2==2 GOTOC NOWHERE", "IF R1==1 OR R2==2 GOTOC NOWHERE", "IF R1<R2<R3 GOTOC NOWHERE"),
        *("IF NOT R1==2 GOTOC NOWHERE", "WHILE R1>0 AND R2>0\nENDWHILE", "REPEAT\nUNTIL R1>3 OR R2>3", "R1=R2==R3==R4"),
        *("IF R1==1 XOR R2==2\nENDIF", "IF (R1==1) AND R2==2\nENDIF", "IF R1==1 AND (R2==2)\nENDIF", "R1=(R2>3 OR R4)"),
        *("IF TRUE AND R1>3\nENDIF",),
    ),
    "E-LEGAL-R": (
        *("R=5", "R1.5=3", "R1=R", "R-1=5", "R1=R2.5", "R+1=3", "FOR R=1 TO 3\nENDFOR", "R1=R*2", "X1=R+5", "F=R"),
        *("R0.0=1", "IF R==1 GOTOC NOWHERE"),
    ),
    "E-LEGAL-RESULT": (
        *(
            'DELETE("_N_TFX_SPF","_N_TFX_SPF")',
            'WRITE(0,"_N_TFX_SPF","x")',
            'DELETE(5,"_N_TFX_SPF")',
            'DELETE(,"_N_TFX_SPF")',
        ),
        *(
            'WRITE("","_N_TFX_SPF","x")',
            'READ(1,"_N_TFX_SPF",1,1,R2)',
            'WRITE(-R1,"_N_TFX_SPF","x")',
            'WRITE((R1),"_N_TFX_SPF","x")',
        ),
        *(
            'DELETE(SIN(3),"_N_TFX_SPF")',
            'READ(,"_N_TFX_SPF",1,1,R2)',
            'WRITE(1.5,"_N_TFX_SPF","x")',
            "DELETE('H1',\"_N_TFX_SPF\")",
        ),
    ),
    "E-LEGAL-SKIPPED": (
        *(
            f"/{level}{opener}\n{closer}"
            for level in ("", "1 ", "9 ")
            for opener, closer in (
                ("IF R1==1", "ENDIF"),
                ("LOOP", "ENDLOOP"),
                ("FOR R1=0 TO 3", "ENDFOR"),
                ("N7 WHILE R1<3", "ENDWHILE"),
            )
        ),
    ),
    "E-LEGAL-STRING": (
        *('MSG("open)', 'R1=STRLEN("A)', 'WRITE(R1,"_N_A_SPF","x)', '"', 'MSG("a""b"")', 'MSG(a")', 'SETAL(65000,"x)'),
        *('IF R1==" GOTOC NOWHERE', 'DELETE(R1,"_N_A_SPF)', 'MSG("a"<<")', 'T="DRILL', 'R1=ISFILE("A)', 'CALL "X'),
    ),
    "E-LEGAL-STRING-LENGTH": tuple(f'MSG("{"x" * n}")' for n in range(201, 213)),
    "E-LEGAL-SYNTAX": (
        *(
            "R1=",
            "R1=2+",
            "R1=*2",
            "R1=2 3",
            "FOR R1=0 3\nENDFOR",
            "FOR R1 0 TO 3\nENDFOR",
            "R1=SIN 30",
            "GOTOF",
            "5",
            "(R1)",
        ),
        *(
            "LOOP R1=2\nENDLOOP",
            "IF\nENDIF",
            "R1=(2,3)",
            'MSG("a" "b")',
            "CASE R1 GOTOC UA",
            "IF R1==1 R2=2\nENDIF",
            "R1=2++",
            "R1=TO",
            '"A"',
            "X1,X2=3",
        ),
    ),
    "E-LEGAL-TYPE": (
        *(
            'R1="A"',
            "R1=(X1)",
            '$AN_CEC[0,0]="1"',
            "$AN_CEC_INPUT_AXIS[0]=1",
            'X1="A"',
            "X=(Y1)",
            'F="100"',
            'R1=SIN("30")',
        ),
        *(
            '$AA_ENC_COMP[0,0,X1]="1"',
            "R1=STRLEN(5)",
            'FOR R1="A" TO 3\nENDFOR',
            "R1=ISFILE(5)",
            "R1=$P_PROG[0]",
            "MSG(5)",
        ),
    ),
    "E-LEGAL-UNCLOSED": (
        *(
            "IF R1==1",
            "FOR R1=0 TO 3",
            "WHILE R1<3",
            "LOOP",
            "REPEAT",
            "N10 LOOP",
            "IF (R1==1) AND (R2==2)",
            "if r1==1",
        ),
        *("FOR R[5]=0 TO 3", "WHILE TRUE", "LOOP ; for ever", "IF R1==1\nELSE", "REPEAT ; and again"),
    ),
    "E-LEGAL-UNDEFINED": (
        *(
            "UNEVER=5",
            "R1=UNEVER",
            "IF UNEVER>3 GOTOC NOWHERE",
            "UNEVER[1]=5",
            "FOR UNEVER=0 TO 3\nENDFOR",
            "R[UNEVER]=1",
        ),
        *(
            'MSG("a"<<UNEVER)',
            "X1=UNEVER",
            "$AN_CEC[UNEVER,0]=1",
            "R1=SIN(UNEVER)",
            "WHILE UNEVER\nENDWHILE",
            "F=UNEVER*2",
        ),
    ),
    "E-LEGAL-VALUES": (
        *(
            "R1=SIN()",
            "R1=SIN(1,2)",
            "R1=ATAN2(1)",
            "R1=SQRT(1,2)",
            'WRITE(R1,"_N_A_SPF")',
            "DELETE(R1)",
            'READ(R1,"_N_AB_SPF")',
        ),
        *(
            "STOPRE(1)",
            "NEWCONF(1)",
            "R1=MAXVAL(1)",
            "R1=BOUND(1,2)",
            "SETAL()",
            'R1=ISFILE("AB","C")',
            'MSG("a",1,2)',
            "X=AC(1,2)",
        ),
    ),
    "E-LEGAL-VARIABLE": (
        *(
            "$AA_ENC_KOMP[0,0,X1]=0",
            "$MA_NO_SUCH_DATUM[X1]=1",
            "R1=$MN_MM_CEC_MAX_POINT[0]",
            "$SN_CEC_TABLE_ENABLED[0]=1",
        ),
        *(
            "R1=$A",
            "IF $AC_FOO==1 GOTOC NOWHERE",
            "$AN_CEC_MIN_[0]=1",
            "R1=$AA_IMM[X1]",
            "MSG(<<$P_NAME)",
            "$MC_BACKLASH[0]=1",
        ),
        *("$UTARGET=5", "R1=$VA_ENC3_COMP_VAL[X1]", "R1=$R1"),
    ),
    "E-LEGAL-WORD": (
        *(
            "QUARK",
            "ENDIFF",
            "ELSEIF",
            "END",
            "STOPREE",
            "NEWCONFIG",
            "UNKNOWN(1,2)",
            "R1=SINUS(30)",
            'PRINT("a")',
        ),
        *("EXIT", "R1=FOO(2)", "BREAK", "RETURN", "CONTINUE", "SUPPA G1 X1=5"),
    ),
    "E-LEGAL-WRITE": tuple(f'WRITE(R1,"_N_TFX_SPF","{"a" * (101 + n)}"<<R{n}<<"{"b" * 100}")' for n in range(1, 13)),
}
