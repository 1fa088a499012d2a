"""The meshes that descriptions of robots name: found below a search path, and loaded once."""

from collections.abc import Iterable
import os
from pathlib import Path
from queue import SimpleQueue
import re
from threading import Thread
from typing import Optional, Union
from urllib.parse import unquote

from puretf_tools.view.mesh_loader import end, load, Mesh, MeshError

#: The scheme, or '' of a relative path, and the rest. RFC 3986 has no colon at its beginning.
_NAME = re.compile(r'(?:(package|file)://|(?![^/]*:|$))(.*)', re.DOTALL)
REMEDY = 'pass --meshes DIR, where DIR has the package or the file'


class MissingMesh(MeshError):
    """The file of a mesh is not found."""


class Meshes:
    """The meshes below the directories of a search path, by their file in a description."""

    def __init__(self, directories: Iterable[str] = ()) -> None:
        """Search these directories, then `share` of each prefix of a ROS environment."""
        prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
        self._directories = [Path(os.path.abspath(directory)) for directory in (
            *directories, *(os.path.join(prefix, 'share') for prefix in prefixes if prefix))]
        #: By file; None: it is being loaded.
        self._loaded: dict[str, Union[Mesh, MeshError, None]] = {}
        self._wanted: SimpleQueue[str] = SimpleQueue()
        self._thread: Optional[Thread] = None

    def get(self, file: str) -> Union[Mesh, MeshError, None]:
        """Return a mesh, or why there is none; None: a thread loads it, ask again later."""
        if file not in self._loaded:
            self._loaded[file] = None
            self._wanted.put(file)
            if self._thread is None:
                self._thread = Thread(target=self._load_wanted, daemon=True)
                self._thread.start()
        return self._loaded[file]

    def forget_failures(self) -> None:
        """Try again to load the meshes that could not be loaded, when they are asked for."""
        for file, mesh in [*self._loaded.items()]:
            if isinstance(mesh, MeshError):
                del self._loaded[file]

    def load(self, file: str) -> None:
        """Load a mesh now."""
        if self._loaded.get(file) is None:
            try:
                self._loaded[file] = load(self.find(file))
            except MeshError as error:
                self._loaded[file] = error

    def _load_wanted(self) -> None:
        while True:
            self.load(self._wanted.get())
            if self._wanted.empty():
                end()

    def find(self, file: str) -> Path:
        """
        Return the path of a file that a description names.

        Only files below the directories are found. Links in the directories are followed: they
        belong to the user, not to who has sent the description.

        :param file: `package://PACKAGE/PATH`, `file:///PATH` or a relative path.
        """
        found = _NAME.fullmatch(file)
        name = unquote(found[2]) if found else ''
        if not found or '\0' in name or (found[1] == 'file') != name.startswith('/'):
            raise MeshError(
                'only package://PACKAGE/PATH, file:///PATH and relative paths are read')
        if not found[1]:  # relative to a file below or beside a directory
            name = re.sub(r'\A(\.\./)+', '', os.path.normpath(name))
        # os.path.join takes an absolute path as it is.
        paths = [Path(os.path.normpath(os.path.join(directory, name)))
                 for directory in self._directories]
        allowed = [path for path in paths if any(
            directory in path.parents for directory in self._directories)]
        if paths and not allowed:
            raise MeshError(f'it is not below a directory of the search path: {REMEDY}')
        for path in allowed:
            if os.path.isfile(path):  # Path.is_file raises an error for a name that is too long
                return path
        searched = ', '.join(map(str, self._directories))
        raise MissingMesh(f'there is no such file below {searched}: {REMEDY}' if searched else
                          f'there is no directory to search: {REMEDY}')
