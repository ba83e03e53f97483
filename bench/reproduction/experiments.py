"""Experiments: what the paper says, and which folds answer it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from typing import Final, Literal

from bench.reproduction.different import different_shapes
from examples.run_gallery import SHAPES
from planner.pipeline.request import FoldRequest

Outcome = Literal["verified", "tangled"]
PACE: Final = "steps_per_snapshot=10"
"""That of the recording: as many servo steps for a snapshot as there are steps between two."""
THRESHOLD_ALONE: Final = "motor_gain=10,steps_per_snapshot=0"
"""With motors that turn at 10/s: at 60/s the first jump of 22° throws the chain apart."""
LIMITED: Final = "motor_max_force=1000"
"""What holds one module one pitch away against gravity; the published value is not told."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """One fold that answers a statement of the paper.

    Attributes:
        id: Letters, digits and dashes: a name of files and in addresses.
        statement: Which one of ``STATEMENTS`` it answers.
        shape: Of ``examples/shapes``, or a file without its ending.
        request: How it is folded.
        title: For people.
        start: The experiment whose plan it begins folded as; None from straight.
        published: What came of it in the paper; None where it is not told.
        published_steps: Steps of the fold in the paper; None where they are not told.
        strip: Whether it is told in twelve pictures as well, as Figure 3 is.
        straight: Whether there is a picture of it while it is straight, as in Figure 1.
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
        """All that the run depends on, in a line."""
        told = [f"{name}={value}" for name, value in self.request.changed().items()]
        begins = [f"start={self.start}"] if self.start else []
        return ", ".join([self.shape, *told, *begins])


@dataclass(frozen=True, slots=True, kw_only=True)
class Statement:
    """Something that the paper says.

    Attributes:
        id: Of its part of the page.
        heading: Of it.
        where: In the paper.
        quote: Its words.
        published: What came of it there, in a few words.
        words: What there is to know beside the figures.
        pairs: Experiments that play beside each other.
        by_size: Whether it is told from which size on it fails.
    """

    id: str
    heading: str
    where: str
    quote: str
    published: str
    words: str = ""
    pairs: tuple[tuple[str, str], ...] = ()
    by_size: bool = False


STATEMENTS: Final = (
    Statement(
        id="wrench",
        heading="A wrench of 160 cubes",
        where="Figure 3, section 4",
        quote="It took approximately 160000 time steps (or 1600 seconds of simulated time) to "
        "achieve the wrench shape.",
        published="folds in about 160\u202f000 steps",
        words="The explosion is simulated first, then the fold. Red is joint error, as in the "
        "paper. With one servo step for each snapshot, the fold takes a tenth of the explosion's "
        "steps. With ten, as in the recording, it takes as many steps as the explosion.",
    ),
    Statement(
        id="mallet",
        heading="The same chain as a mallet",
        where="Figure 4, section 4",
        quote="Using the same 160 module chain we demonstrated reconfiguration by refolding it "
        "into a mallet as shown in Figure 4. It took approximately 150000 time steps (or 1500 "
        "seconds of simulated time) to achieve the mallet shape.",
        published="refolds in about 150\u202f000 steps",
        words="The refold is one timeline: wrench, straight, mallet.",
    ),
    Statement(
        id="sizes",
        heading="Lower and higher resolution",
        where="Section 4",
        quote="We then successfully folded lower and higher resolution wrench and mallet shapes. "
        "In particular, we successfully folded a 64 module mallet, a 94 module wrench, and a 192 "
        "module mallet. Simulation times grow with chain length […].",
        published="three more sizes fold",
        words="The paper names the first three. The others are ours.",
    ),
    Statement(
        id="shapes",
        heading="More shapes",
        where="Section 5",
        quote="More work is necessary to prove out the scalability and generality of the approach "
        "on more geometries, larger chains, and more shapes.",
        published="left for later",
        words="The ten gallery shapes of 64 to 200 cubes that differ most in size, proportions, "
        "compactness and turns. They were chosen by these measures, not by how they "
        "fold.",
    ),
    Statement(
        id="tetrahedra",
        heading="Tetrahedra",
        where="Figure 1, section 4",
        quote="We also successfully ran the algorithm on the tetrahedral geometry for simple "
        "shapes.",
        published="simple shapes fold",
        words="The paper does not name its shapes. These are rings of twelve tetrahedra, put "
        "together.",
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
        words="There is no explosion: all hinges turn at once from straight to folded, with the "
        "motors and contacts of the other folds. In long chains, motors without a force limit "
        "push modules through each other. Motors with a limit, as in ODE, stop where modules meet, "
        "and the chain stays tangled. The last fold uses the published method with such motors. "
        "Orange marks the largest overlaps.",
    ),
    Statement(
        id="threshold",
        heading="Pacing by the threshold alone",
        where="Section 3, Figure 2",
        quote="Each snapshot acts as a target to which we servo until the largest angle error is "
        "less than some given threshold.",
        published="the rule for all folds",
        words="Taken literally, the rule skips each snapshot that the chain is already near to. "
        "Every hinge may then be 22° behind, and the chain cuts the corners of the recorded "
        "motion. In the other experiments, each snapshot is the target for at least one step. "
        "Here the motor gain is 10/s instead of 60/s, because at 60/s the first jump of 22° throws "
        "the chain apart.",
        by_size=True,
    ),
    Statement(
        id="default",
        heading="The same folds by foldback's own method",
        where="Not in the paper",
        quote="",
        published="not in the paper",
        words="The default preset beside the published method, played in parallel. It takes fewer "
        "steps, because its time step and gains adapt to the chain.",
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
DIRECT: Final = (
    *("wrench-24", "mallet-24", "mallet-64", "wrench-80", "mallet-80"),
    *("wrench-160", "mallet-160"),
)
DIRECT_LIMITED: Final = ("wrench-24", "mallet-64", "wrench-80", "wrench-160", "mallet-160")
BY_THRESHOLD: Final = (
    *("wrench-24", "mallet-64", "wrench-80", "wrench-94", "wrench-128", "wrench-160"),
    "mallet-192",
)


def experiments() -> tuple[Experiment, ...]:
    """All of them, in the order in which they are told."""
    return (
        _paper(
            "wrench",
            "wrench-160",
            published="verified",
            published_steps=160_000,
            strip=True,
            straight=True,
        ),
        _paper(
            "wrench",
            "wrench-160",
            settings=PACE,
            suffix="-at-pace",
            told=", ten steps for each snapshot",
            published="verified",
            published_steps=160_000,
        ),
        _paper("mallet", "mallet-160", published="verified", published_steps=150_000, strip=True),
        _paper(
            "mallet",
            "mallet-160",
            settings=PACE,
            suffix="-at-pace",
            told=", ten steps for each snapshot",
            published="verified",
            published_steps=150_000,
        ),
        Experiment(
            id="refold",
            statement="mallet",
            shape="mallet-160",
            request=FoldRequest(preset="paper"),
            title="From wrench to mallet, 160 cubes",
            start="wrench-160",
            published="verified",
            strip=True,
        ),
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
        *(
            Experiment(
                id=f"direct-{shape}",
                statement="direct",
                shape=shape,
                request=FoldRequest(preset="direct"),
                title=_title(shape),
                published="tangled",
            )
            for shape in DIRECT
        ),
        *(
            Experiment(
                id=f"direct-{shape}-limited",
                statement="direct",
                shape=shape,
                request=FoldRequest(preset="direct", settings=LIMITED),
                title=f"{_title(shape)}, motors of limited force",
                published="tangled",
            )
            for shape in DIRECT_LIMITED
        ),
        _paper(
            "direct",
            "mallet-64",
            settings=LIMITED,
            suffix="-limited",
            told=" by the published method, motors of the same limited force",
        ),
        *(
            _paper("threshold", shape, settings=THRESHOLD_ALONE, suffix="-by-threshold")
            for shape in BY_THRESHOLD
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


def _paper(
    statement: str,
    shape: str,
    *,
    settings: str = "",
    suffix: str = "",
    told: str = "",
    published: Outcome | None = None,
    published_steps: int | None = None,
    strip: bool = False,
    straight: bool = False,
) -> Experiment:
    return Experiment(
        id=shape + suffix,
        statement=statement,
        shape=shape,
        request=FoldRequest(preset="paper", settings=settings),
        title=_title(shape) + told,
        published=published,
        published_steps=published_steps,
        strip=strip,
        straight=straight,
    )


@cache
def _title(shape: str) -> str:
    """``Wrench of 160`` for ``wrench-160``; ``Key of 128`` where a file tells name and cells."""
    name, _, number = shape.rpartition("-")
    if number.isdigit():
        return f"{name.capitalize()} of {number}"
    told = json.loads((SHAPES / f"{shape}.json").read_bytes())
    return f"{str(told['title']).partition(',')[0]} of {len(told['cells'])}"
