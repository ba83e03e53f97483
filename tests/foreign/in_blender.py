"""Import a GLB into Blender and write every module's world matrix at the last frame as JSON."""

import json
import sys

import bpy

bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath=sys.argv[1])
scene = bpy.context.scene
last = max(action.frame_range[1] for action in bpy.data.actions)
scene.frame_set(int(last), subframe=last - int(last))
modules = [
    scene_object for scene_object in bpy.data.objects if scene_object.name.startswith("module_")
]
with open(sys.argv[2], "w") as file:
    json.dump({module.name: [list(row) for row in module.matrix_world] for module in modules}, file)
