"""Parts of messages."""

from edl_filter.errors import enumerated


def test_enumerations():
    assert [enumerated(names) for names in ((), ("a",), ("a", "b"), ("a", "b", "c"))] == [
        "",
        "a",
        "a and b",
        "a, b and c",
    ]
