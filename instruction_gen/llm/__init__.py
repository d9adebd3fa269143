"""A language model as a writer: asked with facts, checked, cached, within a budget."""
