"""The options of every command, one dataclass per command.

`vlnpe COMMAND --help` imports nothing else, so these modules import no numerical library. Defaults
that belong to such modules are repeated here; a test compares them.
"""

from typing import Annotated

import tyro

Json = Annotated[bool, tyro.conf.arg(name="json")]
