"""Programs of an FX2N, as people write them."""

from __future__ import annotations

from typing import Final

SELF_HOLDING = """\
; X0 = start button
; X1 = stop button, opens
; Y0 = conveyor contactor

; conveyor on and off
    0 LD X0 ; pressed
    1 OR Y0
    2 AND X1
    3 OUT Y0
; running long enough
    4 LD Y0
    5 OUT T0 K50
    8 LD T0
    9 OUT Y1
   10 END
"""

BRANCHES = """\
ld x000
or m0
ldi x001
and x2
ld x3
ani x4
orb
anb
mps
and x005
out y000
mrd
andp m8013
set m10
mrd
ld x6
orf x7
anb
out c0 k10
mpp
inv
rst c0
ldp x10
pls m11
ldf x10
plf m12
ld m11
orp m12
out y10
rst m10
ld c0
ldp m10
orb
and m1536
out m3071
end
"""

APPLIED = """\
LD M8002
MOV K-5, D0
DMOV H0FFFF00 D10
MOV D20V0 K1M10Z
DMOV D0Z2 K8M0
BMOV D0 D100 K10
FMOV K0 D200 K20
LDP X0
ADD D0 K100 D1 // sum
DADDP D10 D12 D14
DIV D1 K7 D2
WANDP D1 H0F D3
INCP Z0
CMP K100 D1 M1
ZCP K100 K200 D1 M4
SFTLP X1 M20 K16 K4
DECO D0 M40 K4
ZRST S20 S30
ZRST M100 M200
LD= D0 K5
OR<> T0 K100
ANDD>= C200 K-70000
ALTP M50
LDD> D10 D12
OUT C200 K-100000
OUT T246 D5
LD X3
ANS T199 K30 S900
ANRP
LD X20
REF X10 K8
REFF K5
DPLSY K1000 K50000 Y0
LD D100.F
OUT D101.0
LD M1
RST D5
RST V3
END
"""

STEPS = """\
; S0 = waiting
; S20 = lower
; from the first scan on
LD M8002
ZRST S20 S22
SET S0
; waiting
STL S0
LD X0
SET S20
SET S21
STL S20
OUT Y0
OUT T0 K20
LD T0
SET S22
STL S21
LD X1
MPS
OUT Y1
AND X2
SET S23
MPP
ANI X3
OUT Y2
STL S22
STL S23
LD M8000
WDT
LD X4
OUT S0
RET
LD S22
OUT Y3
END
"""

FLOW = """\
LD X0
CJ P1
LD X1
MC N0 M100
LD X2
OUT Y0
LD X3
MC N1 Y7
LD X4
OUT T10 K5
MCR N1
MCR N0
P1
LD X5
CALL P10
CALLP P127
LDI X6
CJ P63
FOR K4
FOR D0
LD X7
INC D1
NEXT
NEXT
FEND
P10: ; first
LD M8000
MOV D0 D2
SRET
; the other one
P127
WDT
LD X17
DECP D2
SRET
END
"""

SAMPLES: Final = (SELF_HOLDING, BRANCHES, APPLIED, STEPS, FLOW)
