"""The SINUMERIK 840D language subset as an LALR grammar: what a block may look like, and nothing of what it means.

Order of operators: Programming Manual Job Planning, "Priority of the operations" (NOT, B_NOT; * / DIV MOD;
+ -; B_AND; B_XOR; B_OR; AND; XOR; OR; <<; comparisons last), so two comparisons joined by AND need brackets.
"""

from __future__ import annotations

GRAMMAR = r"""
?start: words | control | "IF" expr jump -> if_jump | case | define | proc | extern

control: IF expr -> conditional | WHILE expr -> conditional | UNTIL expr -> conditional
       | (ELSE | ENDIF | ENDFOR | ENDWHILE | REPEAT | LOOP | ENDLOOP) -> structural
       | "FOR" target "=" expr "TO" expr -> counting
words: word* [jump]
?word: ADDRESS -> address
     | NAME -> bare
     | NAME "(" [args] ")" -> procedure
     | target "=" value -> assign
jump: (GOTOF | GOTOB | GOTO | GOTOC) NAME
case: "CASE" expr "OF" arm+ ["DEFAULT" jump]
arm: signed jump
signed: [MINUS] NUMBER
define: "DEF" NAME ["[" expr "]"] declared ("," declared)*
declared: NAME ["[" args "]"] ["=" value]
proc: "PROC" NAME ["(" [parameter ("," parameter)*] ")"] NAME*
parameter: [VAR] NAME ["[" expr "]"] NAME ["=" expr]
extern: "EXTERN" NAME ["(" [kind ("," kind)*] ")"]
kind: [VAR] NAME ["[" [expr] "]"]

target: NAME -> name | NAME "[" args "]" -> indexed | SYSVAR -> name | SYSVAR "[" args "]" -> indexed
?value: expr | "(" expr ("," expr)+ ")" -> listing
args: expr ("," expr)*

?expr: concat | concat COMPARE concat -> binary | expr_chain
expr_chain: concat COMPARE concat (COMPARE concat)+
?concat: or_ | concat SHL or_ -> binary | SHL or_ -> unary
?or_: xor_ | or_ OR xor_ -> binary
?xor_: and_ | xor_ XOR and_ -> binary
?and_: bor | and_ AND bor -> binary
?bor: bxor | bor B_OR bxor -> binary
?bxor: band | bxor B_XOR band -> binary
?band: sum | band B_AND sum -> binary
?sum: product | sum (PLUS | MINUS) product -> binary
?product: factor | product (TIMES | OVER | DIV | MOD) factor -> binary
?factor: atom | (MINUS | PLUS | NOT | B_NOT) factor -> unary
?atom: NUMBER -> number | RADIX -> radix | STRING -> text
     | NAME -> name | NAME "[" args "]" -> indexed | NAME "(" [args] ")" -> call
     | SYSVAR -> name | SYSVAR "[" args "]" -> indexed | "(" expr ")" -> bracket

IF: "IF"
WHILE: "WHILE"
UNTIL: "UNTIL"
ELSE: "ELSE"
ENDIF: "ENDIF"
ENDFOR: "ENDFOR"
ENDWHILE: "ENDWHILE"
REPEAT: "REPEAT"
LOOP: "LOOP"
ENDLOOP: "ENDLOOP"
GOTOF: "GOTOF"
GOTOB: "GOTOB"
GOTO: "GOTO"
GOTOC: "GOTOC"
VAR: "VAR"
OR: "OR"
XOR: "XOR"
AND: "AND"
B_OR: "B_OR"
B_XOR: "B_XOR"
B_AND: "B_AND"
NOT: "NOT"
B_NOT: "B_NOT"
DIV: "DIV"
MOD: "MOD"
PLUS: "+"
MINUS: "-"
TIMES: "*"
OVER: "/"
SHL.4: "<<"
COMPARE: "==" | "<>" | "<=" | ">=" | "<" | ">"
ADDRESS.3: /[A-Z] *[+-]? *(?:\d+\.?\d*|\.\d+)(?:EX[+-]?\d+)?(?![\d.]|\s*[=\[(])/
NUMBER: /(?:\d+\.?\d*|\.\d+)(?:EX[+-]?\d+)?/
RADIX: /'[HB][0-9A-F]+'/
STRING: /"[^"]*"/
SYSVAR: /\$[A-Z]{1,3}_[A-Z0-9_]+/
NAME: /[A-Z_][A-Z0-9_]*/
%ignore /[ \t]+/
"""
