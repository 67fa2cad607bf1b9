"""Generated expressions over a small vocabulary with a spare word in each group."""

from hypothesis import strategies as st

from pa_ros.language import And, Expression, Not, Or, Vocabulary, Word

VOCABULARY = Vocabulary.of(shape=("CUBE", "SPHERE", "C"), color=("RED", "GREEN", "A"))
words = st.sampled_from(VOCABULARY.words).map(Word)


def expressions(max_leaves: int) -> st.SearchStrategy[Expression]:
    """Expressions of any shape, with about that many words at most."""

    def wider(inner: st.SearchStrategy[Expression]) -> st.SearchStrategy[Expression]:
        operands = st.lists(inner, min_size=2, max_size=4).map(tuple)
        return st.one_of(inner.map(Not), operands.map(And), operands.map(Or))

    return st.recursive(words, wider, max_leaves=max_leaves)
