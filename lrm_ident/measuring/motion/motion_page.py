"""The page of `lrm-ident motion report`: the results and the picture as one file that needs no network."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory

from lrm_ident.measuring.motion.motion_picture import draw_motion
from lrm_ident.measuring.motion.motion_study import MotionStudy
from lrm_ident.report.document import Document, blocks_html

PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; img-src data:">
<title>{title}</title>
<style>
body {{ font: 15px/1.45 system-ui, sans-serif; margin: 0 auto; max-width: 1000px; padding: 16px; }}
table {{ border-collapse: collapse; margin: 8px 0 16px; font-size: 13px; font-variant-numeric: tabular-nums; }}
th, td {{ padding: 2px 10px 2px 0; text-align: left; border-bottom: 1px solid #ddd; }}
th.right, td.right {{ text-align: right; }} caption {{ text-align: left; font-weight: 600; }}
.wide {{ overflow-x: auto; }} img {{ max-width: 100%; }}
.lrm-share {{ display: inline-block; height: 9px; background: #0072b2; }}
dl.facts {{ display: grid; grid-template-columns: max-content 1fr; gap: 2px 12px; }} dd {{ margin: 0; }}
</style>
</head>
<body>
<h1>{title}</h1>
{body}
</body>
</html>
"""


def motion_page(before: MotionStudy, after: MotionStudy, documents: Sequence[Document]) -> str:
    """The page's text: documents in order, and the picture of the worst move before and after."""
    with TemporaryDirectory() as folder:
        picture = Path(folder) / "move.png"
        draw_motion(before, after, picture)
        image = b64encode(picture.read_bytes()).decode()
    shown = f'<p><img alt="Command, reading and prediction of the worst move" src="data:image/png;base64,{image}"></p>'
    first, *others = (blocks_html(document.whole) for document in documents)
    title = f"Motion: {after.moves.name}, {after.moves.arm.name}"
    return PAGE.format(title=escape(title), body="\n".join([first, shown, *others]))
