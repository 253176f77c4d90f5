"""Outputs of the notebooks in the repository: small pictures, and texts that an execution is compared with."""

import base64
import html
import io
import re

from PIL import Image

#: Widest picture, pixels, and number of its colours.
WIDTH, COLOURS = 760, 128
#: Relative difference of numbers that count as equal: another machine rounds otherwise, iterations stop elsewhere.
RELATIVE = 0.02
#: A number in a text: with digits after the point, or with an exponent.
NUMBER = re.compile(r"(?<![\w.])[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w])")


def small_picture(png):
    """A PNG (base 64) with fewer pixels and colours."""
    image = Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB")
    if image.width > WIDTH:
        image = image.resize((WIDTH, round(image.height * WIDTH / image.width)), Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    palette = image.quantize(COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    palette.save(buffer, "png", optimize=True)
    return base64.b64encode(buffer.getvalue()).decode()


def to_store(notebook):
    """Prepare an executed notebook for the repository: small pictures, joined streams, no metadata of the execution."""
    for k, cell in enumerate(c for c in notebook.cells if c.cell_type == "code"):
        cell.execution_count = k + 1
        cell.metadata = {}
        outputs = []
        for output in cell.outputs:
            if output.output_type == "stream" and output.name == "stderr":
                continue
            if "data" in output:
                output.metadata = {}
                if "image/png" in output.data:
                    output.data = {"image/png": small_picture(output.data["image/png"])}
                elif "text/html" in output.data:  # the representation as text may be long, and is not displayed
                    output.data = {"text/html": output.data["text/html"]}
            if output.output_type == "execute_result":
                output.execution_count = k + 1
            if outputs and output.output_type == "stream" and outputs[-1].output_type == "stream":
                outputs[-1].text += output.text
            else:
                outputs.append(output)
        cell.outputs = outputs
    return notebook


def texts(cell):
    """Texts that a cell of code displays: printed ones, tables, representations."""
    printed = "".join(o.text for o in cell.outputs if o.output_type == "stream" and o.name == "stdout")
    displayed = [printed] if printed else []
    for output in cell.outputs:
        data = output.get("data", {})
        if "text/html" in data:
            if "xr-" not in data["text/html"]:  # the table of an xarray object, whose identifiers are random
                displayed.append(
                    html.unescape(re.sub(r"<style.*?</style>|<[^>]+>", " ", data["text/html"], flags=re.S))
                )
        elif "text/plain" in data and "image/png" not in data:
            displayed.append(data["text/plain"])
    return displayed


def difference(stored, executed):
    """The first difference of two texts that is more than rounding; None if there is none."""
    words = [NUMBER.sub("#", text).split() for text in (stored, executed)]
    if words[0] != words[1]:
        pairs = [pair for pair in zip(*words, strict=False) if pair[0] != pair[1]]
        return f"stored {pairs[0][0]!r}, executed {pairs[0][1]!r}" if pairs else "one text is longer"
    for a, b in zip(NUMBER.findall(stored), NUMBER.findall(executed), strict=True):
        if abs(number(a) - number(b)) > max(RELATIVE * abs(number(a)), 2.0 * last_digit(a)):
            return f"stored {a}, executed {b}"
    return None


def number(text):
    """Value of a number with either minus sign."""
    return float(text.replace("−", "-"))


def last_digit(text):
    """Value of one unit of the last digit of a number."""
    mantissa, _, exponent = text.partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 10.0 ** (int(exponent or 0) - decimals)
