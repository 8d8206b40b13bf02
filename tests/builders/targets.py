"""Small sound files of targets."""

PHANTOM = """<PlusConfiguration version="2.1">
  <CoordinateDefinitions>
    <Transform From="Phantom" To="Reference" Matrix="1 0 0 5  0 1 0 0  0 0 1 0  0 0 0 1" />
  </CoordinateDefinitions>
  <PhantomDefinition><Geometry><Pattern Type="NWire">
    <Wire Name="a" EndPointFront="0 0 0" EndPointBack="0 40 0" />
  </Pattern></Geometry></PhantomDefinition>
</PlusConfiguration>
"""


LINE = '[[line]]\nname = "n"\nframe = "Needle"\nfrom_mm = [0, 0, 0]\nto_mm = [0, 0, 1]\n'


POINT = '[[point]]\nname = "tip"\nframe = "Stylus"\nat_mm = [0.0, 0.5, -150]\n'


PLANE = '[[plane]]\nname = "floor"\nframe = "Tracker"\npoint_mm = [0, 0, 5]\nnormal = [0.0, 0.1, 1.0]\n'
