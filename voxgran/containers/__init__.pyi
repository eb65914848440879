from voxgran.containers.box import Box as Box
from voxgran.containers.closed_mesh import ClosedMesh as ClosedMesh
from voxgran.containers.cylinder import Cylinder as Cylinder
from voxgran.containers.disk import Disk as Disk
from voxgran.containers.make import make_container as make_container
from voxgran.containers.polygon import Polygon as Polygon
from voxgran.containers.rectangle import Rectangle as Rectangle
from voxgran.containers.sphere import Sphere as Sphere
