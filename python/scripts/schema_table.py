"""Lists the published schemas on the book's page of MATLAB and R: ``python schema_table.py``."""

from __future__ import annotations

import json
from pathlib import Path

BOOK = Path(__file__).resolve().parents[2] / "docs" / "src"
HEAD = "## Schemas\n"


def main() -> None:
    page = BOOK / "python" / "matlab-and-r.md"
    rows = []
    for file in sorted((BOOK / "reference" / "schemas").glob("*.schema.json")):
        schema = json.loads(file.read_text())
        command = schema["title"].removeprefix("carpus ").removesuffix(" --json")
        rows.append(f"| `{command}` | [{file.name}](../reference/schemas/{file.name}) |")
    before = page.read_text().partition(HEAD)[0]
    page.write_text(before + HEAD + "\n| command | schema |\n|---|---|\n" + "\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
