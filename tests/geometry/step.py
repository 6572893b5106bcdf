"""STEP files written by hand: a ball and a block, in any unit."""

import itertools

LENGTHS = {
    "mm": "LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.)",
    "m": "LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT($,.METRE.)",
    "inch": "CONVERSION_BASED_UNIT('INCH',#15)LENGTH_UNIT()NAMED_UNIT(#14)",
}
HEAD = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('part','2020-01-01T00:00:00',(''),(''),'','','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));
ENDSEC;
DATA;
#1=APPLICATION_CONTEXT('');
#2=PRODUCT_CONTEXT('',#1,'mechanical');
#3=PRODUCT('part','part','',(#2));
#4=PRODUCT_DEFINITION_FORMATION('','',#3);
#5=PRODUCT_DEFINITION_CONTEXT('part definition',#1,'design');
#6=PRODUCT_DEFINITION('design','',#4,#5);
#7=PRODUCT_DEFINITION_SHAPE('','',#6);
#8=SHAPE_DEFINITION_REPRESENTATION(#7,#9);
#9=ADVANCED_BREP_SHAPE_REPRESENTATION('',(#20),#10);
#10=(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNIT_ASSIGNED_CONTEXT((#11,#12,#13))REPRESENTATION_CONTEXT('',''));
#11=({length});
#12=(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.));
#13=(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT());
#14=DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.);
#15=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#16);
#16=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));
#20=MANIFOLD_SOLID_BREP('',#21);
"""


def step_text(entities, unit):
    head = HEAD.format(length=LENGTHS[unit])
    return head + "".join(f"{line};\n" for line in entities) + "ENDSEC;\nEND-ISO-10303-21;\n"


def ball(radius, unit="mm"):
    """A ball about the origin."""
    return step_text(
        [
            "#21=CLOSED_SHELL('',(#22))",
            "#22=ADVANCED_FACE('',(#23),#27,.T.)",
            "#23=FACE_BOUND('',#24,.T.)",
            "#24=VERTEX_LOOP('',#25)",
            "#25=VERTEX_POINT('',#26)",
            f"#26=CARTESIAN_POINT('',(0.,0.,{-radius!r}))",
            f"#27=SPHERICAL_SURFACE('',#28,{radius!r})",
            "#28=AXIS2_PLACEMENT_3D('',#29,#30,#31)",
            "#29=CARTESIAN_POINT('',(0.,0.,0.))",
            "#30=DIRECTION('',(0.,0.,1.))",
            "#31=DIRECTION('',(1.,0.,0.))",
        ],
        unit,
    )


def block(*size, unit="mm"):
    """A box with one corner at the origin and sides (x, y, z)."""
    lines, number = [], itertools.count(100)

    def add(text):
        lines.append(f"#{next(number)}={text}")
        return lines[-1].partition("=")[0]

    def triple(kind, values):
        return add(f"{kind}('',({','.join(repr(float(v)) for v in values)}))")

    corners = list(itertools.product((0, 1), repeat=3))
    points = {c: triple("CARTESIAN_POINT", [s * v for s, v in zip(size, c, strict=True)]) for c in corners}
    ends = {c: add(f"VERTEX_POINT('',{points[c]})") for c in corners}
    edges = {}
    for a, axis in itertools.product(corners, range(3)):
        if a[axis] == 0:
            b = tuple(1 if k == axis else v for k, v in enumerate(a))
            way = triple("DIRECTION", [k == axis for k in range(3)])
            vector = add(f"VECTOR('',{way},1.)")
            line = add(f"LINE('',{points[a]},{vector})")
            edges[a, b] = add(f"EDGE_CURVE('',{ends[a]},{ends[b]},{line},.T.)")
    faces = []
    for axis, side in itertools.product(range(3), (0, 1)):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        ring = []
        for at_u, at_v in ((0, 0), (1, 0), (1, 1), (0, 1)) if side else ((0, 0), (0, 1), (1, 1), (1, 0)):
            corner = [0, 0, 0]
            corner[axis], corner[u], corner[v] = side, at_u, at_v
            ring.append(tuple(corner))
        loop = []
        for a, b in zip(ring, ring[1:] + ring[:1], strict=True):
            ahead = (a, b) in edges
            loop.append(add(f"ORIENTED_EDGE('',*,*,{edges[a, b] if ahead else edges[b, a]},.{'T' if ahead else 'F'}.)"))
        whole = add(f"EDGE_LOOP('',({','.join(loop)}))")
        bound = add(f"FACE_OUTER_BOUND('',{whole},.T.)")
        normal = triple("DIRECTION", [(2 * side - 1) * (k == axis) for k in range(3)])
        across = triple("DIRECTION", [k == u for k in range(3)])
        place = add(f"AXIS2_PLACEMENT_3D('',{points[ring[0]]},{normal},{across})")
        plane = add(f"PLANE('',{place})")
        faces.append(add(f"ADVANCED_FACE('',({bound}),{plane},.T.)"))
    return step_text([f"#21=CLOSED_SHELL('',({','.join(faces)}))", *lines], unit)
