"""Files that hold no numbers: pictures, documents and models, told by how they begin, and what to
take in their place.
"""

from os.path import splitext

from ibrid.errors import SweepError

#: Bytes within which a text says what it is, and a file of parts names them.
_SHOWN = 4096
_DRAWN = (
    "found a picture ({kind}), whose numbers cannot be read from it; save the data behind it, the "
    "table or the recording that the program drew, or read points of the curves with a plot "
    "digitizer and save them as CSV"
)
#: How pictures begin.
_PICTURES = {
    b"\x89PNG\r\n\x1a\n": "PNG",
    b"\xff\xd8\xff": "JPEG",
    b"GIF8": "GIF",
    b"%PDF-": "PDF",
    b"BM": "BMP",
    b"II*\0": "TIFF",
    b"MM\0*": "TIFF",
    b"%!PS": "PostScript",
    b"\xd7\xcd\xc6\x9a": "WMF",
}
#: Parts of files that are archives -> what the file is, and what to do.
_PARTS = {
    b"word/": "a text document; copy its table into a workbook or a CSV file",
    b"ppt/": "slides; save the data behind the figure as CSV",
    b"simulink/": "a Simulink model; save what it recorded: save('record.mat', 'out', '-v7'), or "
    "its linear model: [A, B, C, D] = linmod('model'); "
    "save('model.mat', 'A', 'B', 'C', 'D', '-v7')",
}
_WEB_PAGE = "a web page; save the table itself as CSV"
#: Endings of the files of recorders that they alone read -> what to save in their place.
_OF_RECORDERS = {
    ".dxd": "Dewesoft; there: Analyse, Export, to Matlab (.mat) or Text/CSV",
    ".d7d": "Dewesoft; there: Analyse, Export, to Matlab (.mat) or Text/CSV",
    ".tdms": "LabVIEW; in DIAdem or Excel save it as CSV, or write .lvm",
    ".trc": "LeCroy; there: File, Save Waveform, format ASCII",
    ".wfm": "Tektronix; there: Save As, Waveform, format .csv",
    ".isf": "Tektronix; there: Save As, Waveform, format .csv",
    ".pl4": "ATP; in PlotXY save the curves as text (.adf), or write COMTRADE",
}
#: The ending of MATLAB's figures, which are MAT files.
_FIGURE = ".fig"


def refuse_without_numbers(content: bytes, where: str) -> None:
    """Raise SweepError for a picture, a document, slides, a model or a web page, which says what to
    take in its place.
    """
    kind = _picture(content)
    if kind:
        raise SweepError(f"{where} must hold numbers; {_DRAWN.format(kind=kind)}.")
    begin = content[:_SHOWN]
    if begin.startswith(b"PK\3\4"):
        for part, words in _PARTS.items():
            if part in begin or part in content[-_SHOWN:]:
                raise SweepError(f"{where} must hold numbers; found {words}.")
    if begin.lstrip().lower().startswith((b"<!doctype html", b"<html")):
        raise SweepError(f"{where} must hold numbers; found {_WEB_PAGE}.")
    if (recorder := _OF_RECORDERS.get(splitext(where)[1].lower())) and b"\0" in content:
        raise SweepError(f"{where} must hold numbers as text; found a file of {recorder}.")
    if where.lower().endswith(_FIGURE):
        raise SweepError(
            f"{where} must hold numbers; found a MATLAB figure; save the data from which it was "
            "drawn, or of one curve, in MATLAB: h = findobj(openfig('bode.fig'), 'Type', 'line'); "
            "writematrix([h(1).XData; h(1).YData]', 'curve.csv')."
        )


def _picture(content: bytes) -> str:
    """PNG, JPEG, .. of a picture; empty for anything else."""
    for begin, kind in _PICTURES.items():
        if content.startswith(begin) and (kind != "BMP" or _is_bitmap(content)):
            return kind
    if content.startswith(b"RIFF") and content[8:12] == b"WEBP":
        return "WebP"
    if content.lstrip()[:5] in (b"<svg ", b"<?xml") and b"<svg" in content[:_SHOWN]:
        return "SVG"
    return ""


def _is_bitmap(content: bytes) -> bool:
    """Whether the length that a bitmap says is its own, as no text that begins with BM says it."""
    return int.from_bytes(content[2:6], "little") == len(content)
