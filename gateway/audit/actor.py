"""Who is at the keyboard, as the operating system knows it; environment variables do not count."""

from __future__ import annotations

import os
import sys

if sys.platform == "win32":

    def os_user() -> str:
        """The name of the user this process belongs to."""
        return os.getlogin()

else:
    import pwd

    def os_user() -> str:
        """The name of the user this process belongs to; ``uid:N`` where the system has no name for him."""
        try:
            return pwd.getpwuid(os.getuid()).pw_name
        except KeyError:
            return f"uid:{os.getuid()}"
