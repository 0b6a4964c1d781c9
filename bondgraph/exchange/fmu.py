"""Models as functional mock-up units (FMI 2.0 and 3.0): model exchange in C, co-simulation in Python.

For model exchange the equations are printed as C and compiled, and the importer integrates. For co-simulation a library
wraps the generated module, and the FMU integrates itself with an adaptive method; where it runs it needs Python, numpy,
scipy and that library.
"""

from __future__ import annotations

import importlib.resources
import io
import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from bondgraph.errors import GenerationError, OptionError, require_kind
from bondgraph.exchange.c_source import c_source
from bondgraph.exchange.fmu_description import description, token, variables
from bondgraph.exchange.slave import build_slave
from bondgraph.files import write_bytes
from bondgraph.simulate.model import Model

Version = Literal["2.0", "3.0"]
Kind = Literal["model-exchange", "co-simulation"]
#: Names of compilers that are looked for, in this order.
_COMPILERS = ("cc", "gcc", "clang")
_EXTENSIONS = {"linux": ".so", "darwin": ".dylib", "win32": ".dll"}
#: Time stamp of files in archives, so that the same model gives the same file.
_STAMP = (1980, 1, 1, 0, 0, 0)


def export_fmu(model: Model, path: Path | str, version: Version = "2.0", kind: Kind = "model-exchange") -> Path:
    """Write a model as an FMU.

    Parameters
    ----------
    model
        The model, without modes; values are in its units, parameters may be changed between steps. States that start at
        an expression of parameters are computed from those that are set before the initialisation ends.
    path
        ``NAME.fmu``.
    version
        Of the standard: ``"2.0"`` or ``"3.0"``.
    kind
        ``"model-exchange"`` (C, compiled for this machine, its sources inside) or ``"co-simulation"`` (Python; needs
        the extra ``fmu``).

    Returns
    -------
    Path
        Of the FMU.

    Raises
    ------
    OptionError
        If version, kind or ending of the file is none.
    GenerationError
        If the model has modes, a library is missing, or the C compiler fails.
    """
    require_kind("export_fmu", model, Model, "model")
    path = Path(path)
    if version not in ("2.0", "3.0") or kind not in ("model-exchange", "co-simulation"):
        raise OptionError(
            f"FMU {version} {kind}: versions are 2.0 and 3.0, kinds model-exchange and co-simulation",
            where=(str(version), str(kind)),
        )
    if path.suffix != ".fmu":
        raise OptionError(f"{path}: an FMU is called NAME.fmu", where=(str(path),))
    if kind == "co-simulation":
        build_slave(model, path, version)
        return path
    files = _sources(model, version)
    binary = _compiled(model, version, files)
    if binary is not None:
        files |= binary
    files["modelDescription.xml"] = description(model, version)
    write_bytes(path, _archive(files))
    return path


def has_compiler() -> bool:
    """Whether a C compiler is found; without one an FMU holds sources alone, which the importer compiles."""
    return any(shutil.which(name) for name in _COMPILERS)


def _sources(model: Model, version: Version) -> dict[str, bytes]:
    template = f"fmi{version[0]}.c"
    wrapper = importlib.resources.files("bondgraph.exchange").joinpath(f"templates/{template}").read_bytes()
    starts = ", ".join("0.0" if one.start is None else repr(one.start) for one in variables(model))
    sizes = {"N_X": model.states, "N_U": model.inputs, "N_P": model.parameters, "N_Y": model.outputs}
    text = c_source(model) + "".join(f"#define {name} {len(infos)}\n" for name, infos in sizes.items())
    text += "#define STARTS\n" if model.parameter_starts else ""
    text += f'#define TOKEN "{token(model, version)}"\nstatic const double START[] = {{{starts or "0.0"}}};\n'
    files = {f"sources/{template}": wrapper, "sources/model.c": text.encode()}
    if version == "3.0":
        build = (
            '<?xml version="1.0" encoding="UTF-8"?>\n<fmiBuildDescription fmiVersion="3.0">\n'
            f'  <BuildConfiguration modelIdentifier="{model.name}">\n    <SourceFileSet language="C99">\n'
            f'      <SourceFile name="{template}"/>\n    </SourceFileSet>\n'
            "  </BuildConfiguration>\n</fmiBuildDescription>\n"
        )
        files["sources/buildDescription.xml"] = build.encode()
    return files


def _compiled(model: Model, version: Version, files: Mapping[str, bytes]) -> dict[str, bytes] | None:
    """The shared library by its place in the FMU; None without a compiler."""
    compiler = next((found for name in _COMPILERS if (found := shutil.which(name))), None)
    if compiler is None:
        return None
    extension = _EXTENSIONS.get(sys.platform, ".so")
    with tempfile.TemporaryDirectory() as folder:
        for name, content in files.items():
            (Path(folder) / Path(name).name).write_bytes(content)
        library = Path(folder) / f"{model.name}{extension}"
        command = [compiler, "-shared", "-fPIC", "-O2", "-std=c99", "-o", str(library), f"fmi{version[0]}.c", "-lm"]
        run = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if run.returncode != 0:
            said = (run.stderr.strip() or "no message").splitlines()[0]
            raise GenerationError(f"{model.name}: {compiler} does not compile its C source: {said}", where=(compiler,))
        return {f"binaries/{_platform(version)}/{library.name}": library.read_bytes()}


def _platform(version: Version) -> str:
    """The folder of binaries of this machine, as the standards call it."""
    system = {"linux": "linux", "darwin": "darwin", "win32": "win" if version == "2.0" else "windows"}[sys.platform]
    if version == "2.0":
        return f"{system}{'64' if sys.maxsize > 2**32 else '32'}"
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    return f"{machine}-{system}"


def _archive(files: Mapping[str, bytes]) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in sorted(files.items()):
            archive.writestr(zipfile.ZipInfo(name, _STAMP), data, zipfile.ZIP_DEFLATED)
    return content.getvalue()
