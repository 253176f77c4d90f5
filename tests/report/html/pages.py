"""The page of a folder and its parts."""

import base64
import json
import re

import numpy as np

from edl_filter.report.html import write_report


def page(folder):
    return write_report(folder).read_text(encoding="utf-8")


def body(text):
    """The page without the library and the data."""
    return re.sub(r"<script.*?</script>", "", text, flags=re.S)


def data(text):
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S).group(1))


def numbers(packed):
    return np.frombuffer(base64.b64decode(packed["bdata"]), "<f4")


def section(text, key):
    return re.search(rf'<section id="{key}".*?</section>', body(text), re.S).group(0)
