"""What an edit changed in the text of a program."""

from difflib import unified_diff


def difference(before: str, after: str, around: int = 1) -> tuple[str, ...]:
    """Lines taken out ("-") and put in ("+"), with `around` lines before and after (" ") and "..." where lines are left out."""
    lines = list(unified_diff(before.splitlines(), after.splitlines(), lineterm="", n=around))[2:]
    return tuple("..." if line.startswith("@@") else line for line in lines)


def unified(before: str, after: str, names: tuple[str, str]) -> str:
    """A unified diff, as patch and git read it, under the names of both texts; "" where they are the same."""
    one, other = (text.splitlines(keepends=True) for text in (before, after))
    first, second = (" ".join(name.split()) for name in names)
    return "".join(unified_diff(one, other, first, second))
