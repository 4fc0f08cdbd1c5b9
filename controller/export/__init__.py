"""Export of the machine program as FX2N instruction list and IEC 61131-3 Structured Text."""
