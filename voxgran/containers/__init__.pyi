from voxgran.containers.kinds.box import Box as Box
from voxgran.containers.kinds.cylinder import Cylinder as Cylinder
from voxgran.containers.kinds.disk import Disk as Disk
from voxgran.containers.kinds.mesh import ClosedMesh as ClosedMesh
from voxgran.containers.kinds.polygon import Polygon as Polygon
from voxgran.containers.kinds.rectangle import Rectangle as Rectangle
from voxgran.containers.kinds.sphere import Sphere as Sphere
from voxgran.containers.make import make_container as make_container
