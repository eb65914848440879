"""Parameters that the walking methods have lost are refused with what replaces them."""

import pytest

import voxgran as vg
from voxgran._base.errors import CallError, UnknownNameError

BOX = {"kind": "box", "lengths": [4, 4, 4]}


@pytest.mark.parametrize("method", ["digital", "control_point"])
@pytest.mark.parametrize("name", ["settling", "friction", "shaking", "acceleration"])
def test_former_parameters_say_what_replaces_them(method, name):
    words = rf"{name} is not a parameter: .*settle=dict\((friction|shaking)=\.\.\.\)"
    with pytest.raises(UnknownNameError, match=words):
        vg.pack(vg.make_shape("sphere"), vg.Box((4, 4, 4)), method, count=1, **{name: 1})
    scene = {"shape": [{"family": "sphere"}], "container": BOX, "packing": {"method": method, "count": 1, name: 1}}
    with pytest.raises(UnknownNameError, match=words):
        vg.Scene.from_mapping(scene)
    made = {"digital": vg.methods.Digital, "control_point": vg.methods.ControlPoint}[method]
    with pytest.raises(CallError, match=words):
        made(**{name: 1})


def test_other_unknown_names_are_called_unknown():
    with pytest.raises(UnknownNameError, match="'frictions' is unknown"):
        vg.pack(vg.make_shape("sphere"), vg.Box((4, 4, 4)), "digital", count=1, frictions=1)
