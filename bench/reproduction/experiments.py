"""Experiments: statements of the paper, and the folds that test them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Final, Literal

from bench.reproduction.different import different_shapes
from bench.shape_files import SHAPES
from foldback.planner.pipeline.request import FoldRequest

Outcome = Literal["verified", "tangled"]
RECORDING_PACE: Final = "steps_per_snapshot=10"
"""Setting of a fold at the recording's pace: servo steps per snapshot equal the steps between two
snapshots."""
THRESHOLD_ALONE: Final = "motor_gain=10,steps_per_snapshot=0"
"""Settings of a fold paced by the threshold alone, with a motor gain of 10/s: at 60/s the first
jump of 22° throws the chain apart."""
LIMITED_FORCE: Final = "motor_max_force=1000"
"""Setting of motors with a limited force, which holds one module one pitch away against gravity;
the paper does not state the value."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """One fold that tests a statement of the paper.

    Attributes:
        id: Letters, digits and dashes; part of file names and addresses.
        statement: Id of the statement in ``STATEMENTS``.
        shape: File in ``examples/shapes``, without its ending.
        request: Options of the fold.
        title: Title on the page.
        start: Experiment whose folded shape it starts from; None to start straight.
        published: Result in the paper; None if it is not stated.
        published_steps: Steps of the fold in the paper; None if they are not stated.
        strip: True to show twelve pictures as in Figure 3.
        straight: True to show the straight chain as in Figure 1.
    """

    id: str
    statement: str
    shape: str
    request: FoldRequest
    title: str
    start: str | None = None
    published: Outcome | None = None
    published_steps: int | None = None
    strip: bool = False
    straight: bool = False

    @property
    def asked(self) -> str:
        """Everything that the run depends on, in one line."""
        options = [f"{name}={value}" for name, value in self.request.changed().items()]
        begins = [f"start={self.start}"] if self.start else []
        return ", ".join([self.shape, *options, *begins])


@dataclass(frozen=True, slots=True, kw_only=True)
class Statement:
    """A statement of the paper.

    Attributes:
        id: Id of its section of the page.
        heading: Heading of the section.
        where: Place in the paper.
        quote: Quotation from the paper.
        published: Result in the paper, in a few words.
        words: Explanation next to the figures.
        pairs: Experiments that play side by side.
        by_size: Condition with which the summary reports the sizes at which folds work and fail;
            empty to report no sizes.
    """

    id: str
    heading: str
    where: str
    quote: str
    published: str
    words: str = ""
    pairs: tuple[tuple[str, str], ...] = ()
    by_size: str = ""


STATEMENTS: Final = (
    Statement(
        id="wrench",
        heading="A wrench of 160 cubes",
        where="Figure 3, section 4",
        quote="It took approximately 160000 time steps (or 1600 seconds of simulated time) to "
        "achieve the wrench shape.",
        published="folds in about 160\u202f000 steps",
        words="The explosion is simulated first, then the fold. Red shows joint error, as in the "
        "paper. After every ten steps of the explosion, the state of the chain is stored as a "
        "snapshot; the fold moves through these snapshots in reverse. The first fold takes one "
        "step for each snapshot, so it has a tenth as many steps as the explosion. The second "
        "fold takes ten steps for each snapshot, so it has as many steps as the explosion.",
    ),
    Statement(
        id="mallet",
        heading="The same chain as a mallet",
        where="Figure 4, section 4",
        quote="Using the same 160 module chain we demonstrated reconfiguration by refolding it "
        "into a mallet as shown in Figure 4. It took approximately 150000 time steps (or 1500 "
        "seconds of simulated time) to achieve the mallet shape.",
        published="refolds in about 150\u202f000 steps",
        words="The refold is one continuous motion: from the wrench to the straight chain to the "
        "mallet.",
    ),
    Statement(
        id="sizes",
        heading="Lower and higher resolution",
        where="Section 4",
        quote="We then successfully folded lower and higher resolution wrench and mallet shapes. "
        "In particular, we successfully folded a 64 module mallet, a 94 module wrench, and a 192 "
        "module mallet. Simulation times grow with chain length […].",
        published="three more sizes fold",
        words="The paper names the first three shapes; we added the others.",
    ),
    Statement(
        id="shapes",
        heading="More shapes",
        where="Section 5",
        quote="More work is necessary to prove out the scalability and generality of the approach "
        "on more geometries, larger chains, and more shapes.",
        published="left for future work",
        words="These are the ten gallery shapes of 64 to 200 cubes that differ most from each "
        "other in size, proportions, compactness, and the number of bends in the chain per module. "
        "They were chosen by these measures only, not by how well they fold.",
    ),
    Statement(
        id="tetrahedra",
        heading="Tetrahedra",
        where="Figure 1, section 4",
        quote="We also successfully ran the algorithm on the tetrahedral geometry for simple "
        "shapes.",
        published="simple shapes fold",
        words="The paper does not name its shapes. Our shapes consist of rings of twelve "
        "tetrahedra.",
    ),
    Statement(
        id="direct",
        heading="Direct servoing",
        where="Section 4",
        quote="In both cases, the chain got tangled and failed to fold. We also tried even lower "
        "resolution wrenches and mallets of 24, 64, and 80 modules, and again were unable to fold. "
        "Our experience is that chains greater than around twenty modules fail to fold with direct "
        "servoing approach, but of course this is very configuration path specific.",
        published="all tangle",
        words="Except in the last fold, there is no explosion, only a playback: all hinges "
        "turn at once from straight to folded, with the same motors and contacts as in the other "
        "experiments. In long chains, motors without a force limit push modules through each "
        "other. Motors with a force limit, such as those of ODE (the paper's physics engine), stop "
        "where modules meet, and the chain stays tangled. The last fold uses the published method "
        "and motors with such a limit. Orange marks the two modules that overlap most. The overlap "
        "is the shortest distance by which the modules have to move apart. If one module is "
        "twisted against the other, this distance can exceed a module width.",
    ),
    Statement(
        id="threshold",
        heading="Pace set by the error threshold alone",
        where="Section 3, Figure 2",
        quote="Each snapshot acts as a target to which we servo until the largest angle error is "
        "less than some given threshold.",
        published="the paper's rule, taken literally",
        words="Taken literally, the paper's rule skips each snapshot that the chain is already "
        "close to. Every hinge may then be 22° behind its target, and the chain cuts the corners "
        "of the recorded motion. In the other experiments, each snapshot is the target for at "
        "least one step. Here the motor gain is 10/s instead of 60/s, because at 60/s the first "
        "jump of 22° throws the chain apart.",
        by_size="If only the hinge errors decide when the chain goes on to the next snapshot "
        "(stored state of the explosion)",
    ),
    Statement(
        id="default",
        heading="The same folds by foldback's own method",
        where="Not in the paper",
        quote="",
        published="not in the paper",
        words="The films show the default preset and the published method side by side. The "
        "default preset takes fewer steps, because its time step and gains adapt to the chain.",
        pairs=(("wrench-160", "default-wrench-160"), ("mallet-160", "default-mallet-160")),
    ),
)
TETRAHEDRA: Final = (
    ("tetra-ring", "A ring of 12"),
    ("tetra-bar", "A bar of 96"),
    ("tetra-cube-2", "A cube of 96"),
    ("tetra-letter-f", "The letter F of 96"),
    ("tetra-wrench", "A wrench of 192"),
)
"""Shapes of tetrahedra with their titles."""
DIRECT_SHAPES: Final = (
    *("wrench-24", "mallet-24", "mallet-64", "wrench-80", "mallet-80"),
    *("wrench-160", "mallet-160"),
)
"""Shapes that are folded by direct servoing."""
LIMITED_DIRECT_SHAPES: Final = ("wrench-24", "mallet-64", "wrench-80", "wrench-160", "mallet-160")
"""Those that are also folded with motors of limited force."""
THRESHOLD_SHAPES: Final = (
    *("wrench-24", "mallet-64", "wrench-80", "wrench-94", "wrench-128", "wrench-160"),
    "mallet-192",
)
"""Shapes that are folded at the pace of the threshold alone."""


def experiments() -> tuple[Experiment, ...]:
    """Return all experiments, in the order of the page."""
    return (
        *_wrench_and_mallet(),
        *(
            _paper("sizes", shape, published="verified")
            for shape in ("mallet-64", "wrench-94", "mallet-192")
        ),
        *(
            _paper("sizes", shape)
            for shape in ("wrench-24", "mallet-24", "wrench-80", "mallet-80", "wrench-128")
        ),
        *(_paper("shapes", shape) for shape in different_shapes()),
        *(
            Experiment(
                id=shape,
                statement="tetrahedra",
                shape=shape,
                request=FoldRequest(preset="paper"),
                title=title,
                straight=shape == "tetra-bar",
            )
            for shape, title in TETRAHEDRA
        ),
        *(_direct(shape) for shape in DIRECT_SHAPES),
        *(_direct(shape, limited=True) for shape in LIMITED_DIRECT_SHAPES),
        _paper(
            "direct",
            "mallet-64",
            settings=LIMITED_FORCE,
            suffix="-limited",
            addition=" by the published method, motors of the same limited force",
        ),
        *(
            _paper("threshold", shape, settings=THRESHOLD_ALONE, suffix="-by-threshold")
            for shape in THRESHOLD_SHAPES
        ),
        *(
            Experiment(
                id=f"default-{shape}",
                statement="default",
                shape=shape,
                request=FoldRequest(preset="default"),
                title=f"{_title(shape)}, default",
            )
            for shape in ("wrench-160", "mallet-160")
        ),
    )


def _wrench_and_mallet() -> Iterator[Experiment]:
    """Yield the folds of 160 cubes: each shape, at once and at the recording's pace; the refold."""
    for statement, shape, steps in (
        ("wrench", "wrench-160", 160_000),
        ("mallet", "mallet-160", 150_000),
    ):
        yield _paper(
            statement,
            shape,
            published="verified",
            published_steps=steps,
            strip=True,
            straight=statement == "wrench",
        )
        yield _paper(
            statement,
            shape,
            settings=RECORDING_PACE,
            suffix="-at-pace",
            addition=", ten steps for each snapshot",
            published="verified",
            published_steps=steps,
        )
    yield Experiment(
        id="refold",
        statement="mallet",
        shape="mallet-160",
        request=FoldRequest(preset="paper"),
        title="From wrench to mallet, 160 cubes",
        start="wrench-160",
        published="verified",
        strip=True,
    )


def _direct(shape: str, *, limited: bool = False) -> Experiment:
    """Return a fold by direct servoing, with unlimited motors or with motors of limited force."""
    return Experiment(
        id=f"direct-{shape}-limited" if limited else f"direct-{shape}",
        statement="direct",
        shape=shape,
        request=FoldRequest(preset="direct", settings=LIMITED_FORCE if limited else ""),
        title=_title(shape) + (", motors of limited force" if limited else ""),
        published="tangled",
    )


def _paper(
    statement: str,
    shape: str,
    *,
    settings: str = "",
    suffix: str = "",
    addition: str = "",
    published: Outcome | None = None,
    published_steps: int | None = None,
    strip: bool = False,
    straight: bool = False,
) -> Experiment:
    """Return a fold by the published method, with some settings changed."""
    return Experiment(
        id=shape + suffix,
        statement=statement,
        shape=shape,
        request=FoldRequest(preset="paper", settings=settings),
        title=_title(shape) + addition,
        published=published,
        published_steps=published_steps,
        strip=strip,
        straight=straight,
    )


@cache
def _title(shape: str) -> str:
    """Return a title such as ``Wrench of 160``, from the name or the file of a shape."""
    name, _, number = shape.rpartition("-")
    if number.isdigit():
        return f"{name.capitalize()} of {number}"
    content = json.loads((SHAPES / f"{shape}.json").read_bytes())
    return f"{str(content['title']).partition(',')[0]} of {len(content['cells'])}"
