"""The tables of an Alicat double: its data frame (`??D*`) and its manufacturing data (`??M*`).

Sources: the same captures as `alicat_variants`.
"""

from labctl.doubles.alicat_variants import Shown, Unit, Variant

_CURSOR_BACK = "\b\b"


def layout_table(variant: Variant, unit_id: str, full_scale_psi: float, unit: Unit) -> list[str]:
    """The lines of `??D*`."""
    if variant.older_table:
        return _padded(variant, _older_table(variant, unit_id, full_scale_psi / unit.psi, unit.label))
    rows = [
        "D00 ID_ NAME______________________ TYPE_______ WIDTH NOTES___________________",
        "D01 700 Unit ID                    string          1",
        _number_row(2, "006 Gauge Press", variant.pressure, unit),
        _number_row(3, "038 Ga Press Setpt", variant.setpoint, unit),
        "D04 701 *Error                     string          3 ADC",
    ]
    rows += [
        f"D{number:02d} 702 *Status                    string          3 {word}"
        for number, word in enumerate(variant.status_words, start=5)
    ]
    lines = [f"{unit_id} {row}" for row in rows]
    # A captured 10v20 ends its table with an empty line.
    return [*lines, ""] if variant.knows((10, 0)) else lines


def manufacturing_table(
    variant: Variant, unit_id: str, single_valve: bool, full_scale_psi: float
) -> list[str]:
    """The lines of `??M*`."""
    model = f"{'PC' if single_valve else 'PCD'}-{full_scale_psi:.0f}PSIG{'' if single_valve else '-D'}"
    facts: tuple[str, ...]
    if variant.is_gp:
        facts = (
            "Alicat Scientific Inc.",
            "",
            "Ph 520-290-6060",
            "Fax 520-290-0109",
            f"Mdl {model}",
            "Serial No. 123456",
            "Date Mfg. 01/23/2012",
            "Calibrated By SIM",
            f"Software {variant.revision}",
        )
        return _padded(variant, [f"{unit_id}  M{number} {fact}" for number, fact in enumerate(facts)])
    facts = (
        "ALICAT SCIENTIFIC",
        "www.alicat.com",
        "Ph   520-290-6060",
        "info@alicat.com",
        f"Model Number {model}",
        "Serial Number 123456",
        "Date Manufactured 01/09/2025",
        "Date Calibrated   01/09/2025",
        "Calibrated By     SIM",
        f"Software Revision {variant.revision}",
    )
    return [f"{unit_id}  M{number:02d} {fact}" for number, fact in enumerate(facts)]


def _number_row(number: int, name: str, shown: Shown, unit: Unit) -> str:
    kind = "s decimal" if shown.signed else "decimal"
    return (
        f"D{number:02d} {name:<30} {kind:<13} {shown.width}/{shown.decimals} {unit.code:03d} 02 {unit.label}"
    )


def _older_table(variant: Variant, unit_id: str, full_scale: float, label: str) -> list[str]:
    low, high = variant.pressure.format(0.0), variant.pressure.format(full_scale)
    rows = [
        "D00 NAME_______ TYPE_____ MinVal_  MaxVal_  UNITS__",
        "D01 Unit ID     char         A         Z         na",
        f"D02 Pressure    signed    {low}  {high}     {label}",
        f"D03 SetPoint    signed    {low}  {high}     {label}",
        "D04 Error       string         na      ADC       na",
    ]
    rows += [
        f"D{number:02d} Status      string         na      {word}       na"
        for number, word in enumerate(variant.status_words, start=5)
    ]
    return [f"{unit_id}  {row}" for row in rows]


def _padded(variant: Variant, lines: list[str]) -> list[str]:
    return [line + _CURSOR_BACK for line in lines] if variant.is_gp else lines
