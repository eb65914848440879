from voxgran.packing.advancing_front.method import AdvancingFront as AdvancingFront
from voxgran.packing.beds.method import Gravity as Gravity
from voxgran.packing.control_point.parameters import ControlPoint as ControlPoint
from voxgran.packing.digital.fill_method import DigitalFill as DigitalFill
from voxgran.packing.digital.parameters import Digital as Digital
from voxgran.packing.digital.rsa_method import DigitalRsa as DigitalRsa
from voxgran.packing.rsa.method import Rsa as Rsa
