"""An edit as words, and back."""

from collections.abc import Sequence

from ibrid.modules.vocabulary import Vocabulary
from ibrid_policy.diagram_words import input_words, output_words, sharing_words
from ibrid_policy.edit import NumberedEdit, owners_after
from ibrid_policy.grammar import Grammar
from ibrid_policy.numbering import Numbered
from ibrid_policy.tokens import (
    ADD,
    AT,
    CUT,
    DELETE,
    END,
    FREE,
    OWN,
    SAME,
    SWAP,
    TIE,
    WIRE,
    LanguageError,
    kind_word,
    module_word,
)


def edit_words(edit: NumberedEdit, parent: Numbered, vocabulary: Vocabulary) -> list[str]:
    """The answer that stands for an edit."""
    known = {kind.name: kind for kind in vocabulary}
    kinds = list(parent.kinds)
    words: list[str] = []
    for number, kind in edit.swapped:
        kinds[number] = known[kind]
        words += [SWAP, module_word(number), kind_word(kind)]
    for number in edit.removed:
        words += [DELETE, module_word(number)]
    for kind in edit.added:
        words += [ADD, module_word(len(kinds)), kind_word(kind)]
        kinds.append(known[kind])
    for one in edit.rewired:
        words += [AT, *input_words(one.target, kinds)]
        for mark, sources in ((CUT, one.cut), (WIRE, one.wired)):
            for source in sources:
                words += [mark, *output_words(source, kinds)]
    changed = dict(edit.owners or {})
    swapped = {number: known[kind] for number, kind in edit.swapped}
    owners = (
        owners_after(parent, swapped, set(edit.removed), [known[kind] for kind in edit.added])
        | changed
    )
    for number in sorted({slot[0] for slot in changed}):
        own = {
            name: owners[number, name]
            for name in kinds[number].parameters
            if (number, name) in owners
        }
        whole = sharing_words(number, own, kinds)
        if not whole:
            words += [OWN, module_word(number)]
        elif whole[0] == SAME:
            words += [SAME, module_word(number), whole[1]]
        else:
            for (at, name), (lender, lent) in changed.items():
                if at == number and (lender, lent) == (at, name):
                    words += [FREE, module_word(at), f"@{name}"]
                elif at == number:
                    words += [TIE, module_word(at), f"@{name}", module_word(lender), f"@{lent}"]
    return [*words, END]


def read_edit(words: Sequence[str], parent: Numbered, vocabulary: Vocabulary) -> NumberedEdit:
    """The edit of an answer; LanguageError at the first word that the grammar does not allow
    there.
    """
    reader = Grammar(parent, vocabulary)
    for word in words:
        reader.take(word)
    if not reader.ended:
        raise LanguageError("the answer does not come to its end")
    return reader.edit
