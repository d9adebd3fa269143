"""What a model must answer, validated."""

import json
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, WithJsonSchema

from ..language.claims import Step, claims_schema, read_steps

LONGEST_ANSWER = 40_000


class Said(BaseModel):
    """A step: words of an instruction, and what they claim."""

    model_config = ConfigDict(extra="ignore")

    words: str = Field(max_length=600)
    claims: Annotated[list[Any], WithJsonSchema(claims_schema())] = Field(max_length=12)


class Text(BaseModel):
    """One instruction, as steps with claims; as a text alone in another language than English."""

    model_config = ConfigDict(extra="ignore")

    style: str = Field(default="", max_length=20)
    steps: list[Said] = Field(default_factory=list, max_length=24)
    text: str = Field(default="", max_length=2000)

    @property
    def words(self) -> str:
        """All that the instruction says."""
        return (self.text or " ".join(said.words.strip() for said in self.steps)).strip()

    def claimed(self) -> tuple[Step, ...]:
        """Return the steps with their claims, none where the model gave none.

        Raises:
            InputError: a claim has another form.
        """
        return read_steps([said.model_dump() for said in self.steps])


class Answer(BaseModel):
    """All instructions of one request."""

    model_config = ConfigDict(extra="ignore")

    instructions: list[Text] = Field(min_length=1, max_length=64)


class AnswerError(ValueError):
    """The reply is no valid answer; the message is one short line that does not quote it."""


def read_answer[Form: BaseModel](content: str | None, form: type[Form]) -> Form:
    """Validate a model's content, which should be JSON of a form such as `Answer`.

    Raises:
        AnswerError: no JSON, another schema, or too long.
    """
    if not content:
        raise AnswerError("an empty answer")
    if len(content) > LONGEST_ANSWER:
        raise AnswerError(f"an answer of {len(content)} characters")
    start, stop = content.find("{"), content.rfind("}")
    if start < 0 or stop < start:
        raise AnswerError("no JSON in the answer")
    try:
        return form.model_validate(json.loads(content[start : stop + 1]))
    except ValidationError as error:
        where = ".".join(str(part) for part in error.errors()[0]["loc"])
        raise AnswerError(f"the answer has another form ({where})") from None
    except (ValueError, RecursionError):
        raise AnswerError("the answer is broken JSON") from None


def answer_schema(form: type[BaseModel] = Answer, texts: int = 0) -> dict[str, Any]:
    """Return JSON Schema of a form, as servers with structured output take it.

    Args:
        texts: how many instructions are wanted, where it is an `Answer`; 0 = any number. A small
            model writes the same one over and over until the schema stops it.
    """
    name = "instructions" if form is Answer else form.__name__.lower()
    schema = form.model_json_schema()
    if texts:
        schema["properties"]["instructions"]["maxItems"] = texts
    return {"name": name, "schema": schema}
