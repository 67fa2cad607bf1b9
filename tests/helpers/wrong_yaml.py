"""YAML that is wrong in every way: of syntax, of values, and within itself."""

WRONG = {
    "syntax": "a: [",
    "date": "seed: 2024-13-01",
    "digits": f"seed: {'1' * 5000}",
    "hexadecimal": f"seed: 0x{'f' * 5000}",
    "nested": "[" * 3000,
    "deep": "[" * 60 + "]" * 60,
    "deep by aliases": "[&a0 [1]" + "".join(f", &a{i + 1} [*a{i}]" for i in range(900)) + "]",
    "many by aliases": "[&a0 [1]" + "".join(f", &a{i + 1} [*a{i}, *a{i}]" for i in range(30)) + "]",
    "within itself": "a: &p {x: *p}",
    "within itself twice": "a: &p [*p, *p]",
    "no integer": "a: !!int abc",
    "no truth": "a: !!bool maybe",
    "no number": "a: !!float abc",
    "no time": "a: !!timestamp x",
    "an object": "a: !!python/object:os.system {}",
    "no text": 'a: "\\ud800"',
    "no key": "? [a]\n: 1\n? {a: 1}\n: 2",
}
