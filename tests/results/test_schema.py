"""Schemas of the JSON files: complete declarations, and agreement with what is written.

What a diagnosis and an improvement write is validated in `tests/workflow`.
"""

import json
import re

import pytest
from contents import diagnosis, ledger_end, ledger_step, unknown
from jsonschema import Draft202012Validator
from pydantic import BaseModel, ValidationError

from edl_filter.diagnosis.diagnosis import Diagnosis
from edl_filter.postflight.averages import Difference
from edl_filter.postflight.events import Event
from edl_filter.results import Result, schema
from edl_filter.results.files import finite
from edl_filter.results.schema import fields

#: Ends of keys that are units.
UNITS = {"_m": "m", "_s": "s", "_deg": "deg", "_pa": "Pa", "_m_s": "m/s", "_m_s2": "m/s^2", "_hz": "Hz"}
MODELS = {
    m: None
    for module in (fields, schema.summary, schema.diagnosis, schema.ledger)
    for m in vars(module).values()
    if isinstance(m, type) and issubclass(m, schema.Content)
}


@pytest.fixture(scope="module")
def summary(practice_06):
    return json.loads(json.dumps(finite(Result(practice_06).summary())))


def validator(file):
    return Draft202012Validator(schema.json_schemas()[file])


@pytest.mark.parametrize("model", MODELS, ids=lambda m: m.__name__)
def test_every_key_has_a_meaning_and_the_unit_of_its_name(model):
    assert model.__doc__ != schema.Content.__doc__ or model is schema.Content
    for name, field in model.model_fields.items():
        assert field.description, name
        below = re.search(r"BaseModel|Content|edl_filter", str(field.annotation))
        end = max((e for e in UNITS if name.endswith(e)), key=len, default=None)
        if end is not None and not below and name not in ("timing_s",):
            assert re.search(rf"\b{re.escape(UNITS[end])}\b", field.description), name


def test_models_are_strict_and_closed():
    for model in MODELS:
        assert model.model_config["extra"] == "forbid" and model.model_config["strict"], model
    with pytest.raises(ValidationError, match="Input should be a valid number"):
        schema.diagnosis.Estimate.model_validate_json('{"estimate": "1", "sigma": 1.0, "unit": ""}')
    with pytest.raises(ValidationError, match="Extra inputs are not permitted"):
        schema.diagnosis.Estimate.model_validate_json('{"estimate": 1.0, "sigma": 1.0, "unit": "", "more": 1}')


def test_a_run_writes_what_the_schema_says(summary):
    model = schema.Summary.model_validate_json(json.dumps(summary))
    assert json.loads(model.model_dump_json(exclude_unset=True)) == summary
    validator("summary.json").validate(summary)


def test_a_rovers_run_writes_what_the_schema_says(spirit):
    """It has a spacecraft clock, an estimate of the bias before entry, and error states of the entry."""
    content = json.loads(json.dumps(finite(Result(spirit).summary())))
    model = schema.Summary.model_validate_json(json.dumps(content))
    assert json.loads(model.model_dump_json(exclude_unset=True)) == content
    assert model.pre_entry_bias_m_s2.filter is not None and model.entry_state.states
    validator("summary.json").validate(content)


def test_the_order_of_the_keys_is_the_files(summary):
    """So that a file that is read and written again keeps its order."""
    model = schema.Summary.model_validate_json(json.dumps(summary))
    assert json.dumps(model.model_dump(exclude_unset=True)) == json.dumps(summary)


@pytest.mark.parametrize("content", [diagnosis(), unknown()], ids=["missing", "unknown"])
def test_a_diagnosis(content):
    model = schema.DiagnosisContent.model_validate_json(json.dumps(content))
    assert json.loads(model.model_dump_json(exclude_unset=True)) == json.loads(json.dumps(content))
    validator("diagnosis.json").validate(json.loads(json.dumps(content)))


@pytest.mark.parametrize("line", [ledger_step(), ledger_end()], ids=["step", "end"])
def test_a_line_of_the_ledger(line):
    validator("ledger.jsonl").validate(line)


@pytest.mark.parametrize("file", ["summary.json", "diagnosis.json", "ledger.jsonl"])
def test_json_schemas_are_valid_and_closed(file):
    published = schema.json_schemas()[file]
    Draft202012Validator.check_schema(published)
    for definition in (published, *published["$defs"].values()):
        if "properties" in definition:
            assert definition["additionalProperties"] is False
            assert all("description" in p for p in definition["properties"].values())


def test_rows_of_tables_have_the_schemas_fields():
    """What is written with `asdict` has one declaration of its fields in the layer that makes it."""
    assert list(schema.summary.AverageDifference.model_fields) == list(Difference.__dataclass_fields__)
    events = [name for name in Event.__dataclass_fields__ if name != "name"]
    assert [name for name in schema.summary.EventState.model_fields if name in events] == events


def test_hypotheses_are_given_by_name():
    torque = {"parameters": {"dy": {"estimate": 4e-3, "sigma": 1e-4, "unit": "m"}}}
    content = diagnosis()
    content["ranking"][0] |= {"same_as": ["com_offset"], "alternatives": {"com_offset": torque}}
    model = schema.DiagnosisContent.model_validate_json(json.dumps(content))
    hypotheses = model.hypotheses()
    assert set(hypotheses) == {"remnant_torque", "com_offset"}
    assert hypotheses["com_offset"].parameters["dy"].estimate == 4e-3
    assert isinstance(hypotheses["remnant_torque"], BaseModel)


def test_the_content_of_a_diagnosis_has_the_schemas_keys():
    """The method that makes the content, read as text: a key that is added in one place only is found without a run."""
    import inspect

    written = set(re.findall(r'^            "(\w+)":', inspect.getsource(Diagnosis.content), re.MULTILINE))
    assert written == {name for name, field in schema.DiagnosisContent.model_fields.items() if field.is_required()}
