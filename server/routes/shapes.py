"""Routes of shapes: the gallery."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import Response

from server.problems import Problem
from server.routes.folds import Here, problems
from server.schemas import Shape, Shapes

router = APIRouter(prefix="/api/shapes", tags=["shapes"])


@router.get("", summary="The gallery")
def get_shapes(context: Here) -> Shapes:
    """Example shapes that `POST /api/folds` takes by name."""
    return Shapes(
        shapes=[
            Shape(name=shape.name, title=shape.title, modules=shape.modules)
            for shape in context.gallery.shapes()
        ]
    )


@router.get(
    "/{name}.json",
    summary="The path file of a gallery shape",
    responses={200: {"description": "A `foldback-path/1` file"}, **problems(404)},
)
def get_shape(name: str, context: Here) -> Response:
    """A file to start one's own from."""
    shape = context.gallery.shape(name)
    if shape is None:
        raise Problem(404, "no-such-shape", "The gallery has no shape of this name.")
    return Response(
        shape.data,
        media_type="application/json",
        headers={"Content-Disposition": f'attachment; filename="{shape.filename}"'},
    )
