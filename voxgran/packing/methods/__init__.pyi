from voxgran.packing.advancing_front.method import AdvancingFront as AdvancingFront
from voxgran.packing.control_point.method import ControlPoint as ControlPoint
from voxgran.packing.digital.fill_method import DigitalFill as DigitalFill
from voxgran.packing.digital.rsa_method import DigitalRsa as DigitalRsa
from voxgran.packing.digital.walk_method import Digital as Digital
from voxgran.packing.rsa.method import Rsa as Rsa
