// Half of a circular tunnel of 10 m, driven in four rounds of 3 m: hexahedra in layers along the axis.
//
// The mesh of the case:   gmsh -3 tunnel.geo -o tunnel.msh
// A finer one:            gmsh -3 tunnel.geo -setnumber size 0.6 -o fine.msh
//
// Lengths in m: x across from the plane of symmetry, y along the drive, z upwards from the axis.

DefineConstant[ size = 1 ]; // factor on all element sizes

radius = 5; lining = 0.25;
side = 35;              // from the axis to the edges of the model
back = -18; front = 36; // ends of the model; the rounds begin at y = 0
advance = 3; rounds = 4;

around = Ceil(3 / size);  // elements over 45 degrees of the wall
out = Ceil(8 / size);     // from the wall to the edges of the model
growth = 1 + 0.34 * size; // how they grow on the way
along = Ceil(2 / size);   // layers a round

// The cross-section in blocks of four sides; points at -90, -45, 0, 45 and 90 degrees.
centre = newp; Point(centre) = {0, back, 0};
For i In {0:4}
  t = (i - 2) * Pi / 4;
  in[i] = newp; Point(in[i]) = {(radius - lining) * Cos(t), back, (radius - lining) * Sin(t)};
  rk[i] = newp; Point(rk[i]) = {radius * Cos(t), back, radius * Sin(t)};
EndFor
fx[] = {0, side, side, side, 0};
fz[] = {-side, -side, 0, side, side};
For i In {0:4}
  fa[i] = newp; Point(fa[i]) = {fx[i], back, fz[i]};
  thick[i] = newl; Line(thick[i]) = {in[i], rk[i]};
  Transfinite Curve{thick[i]} = 2;
  ray[i] = newl; Line(ray[i]) = {rk[i], fa[i]};
  Transfinite Curve{ray[i]} = out + 1 Using Progression growth;
EndFor
For i In {0:3}
  inner[i] = newl; Circle(inner[i]) = {in[i], centre, in[i+1]};
  outer[i] = newl; Circle(outer[i]) = {rk[i], centre, rk[i+1]};
  rim[i] = newl; Line(rim[i]) = {fa[i], fa[i+1]};
  Transfinite Curve{inner[i], outer[i], rim[i]} = around + 1;
  ring = newll; Curve Loop(ring) = {thick[i], outer[i], -thick[i+1], -inner[i]};
  blocks[i] = news; Plane Surface(blocks[i]) = {ring};
  field = newll; Curve Loop(field) = {ray[i], rim[i], -ray[i+1], -outer[i]};
  blocks[4+i] = news; Plane Surface(blocks[4+i]) = {field};
EndFor
For i In {0:2}
  spoke[i] = newl; Line(spoke[i]) = {centre, in[2*i]};
  Transfinite Curve{spoke[i]} = around + 1;
EndFor
For i In {0:1}
  quarter = newll; Curve Loop(quarter) = {spoke[i], inner[2*i], inner[2*i+1], -spoke[i+1]};
  blocks[8+i] = news; Plane Surface(blocks[8+i]) = {quarter};
EndFor
For i In {0:3}
  Transfinite Surface{blocks[i]} = {in[i], rk[i], rk[i+1], in[i+1]};
  Transfinite Surface{blocks[4+i]} = {rk[i], fa[i], fa[i+1], rk[i+1]};
EndFor
For i In {0:1}
  Transfinite Surface{blocks[8+i]} = {centre, in[2*i], in[2*i+1], in[2*i+2]};
EndFor
Recombine Surface{blocks[]};

// Drawn along the axis: the approach, the rounds and the ground ahead.
faces[] = blocks[];
rock[] = {};
For n In {0:rounds+1}
  If (n == 0)
    made[] = Extrude {0, -back, 0} { Surface{faces[]}; Layers{ Ceil(5 / size) }; Recombine; };
  ElseIf (n <= rounds)
    made[] = Extrude {0, advance, 0} { Surface{faces[]}; Layers{ along }; Recombine; };
  Else
    made[] = Extrude {0, front - rounds * advance, 0} {
      Surface{faces[]}; Layers{ Ceil(6 / size) }; Recombine;
    };
  EndIf
  For i In {0:9}
    faces[i] = made[6*i];
    solids[i] = made[6*i+1];
  EndFor
  rock[] += {solids[4], solids[5], solids[6], solids[7]};
  If (n == 0)
    Physical Volume("approach") = {solids[8], solids[9]};
    Physical Volume("lining-approach") = {solids[0], solids[1], solids[2], solids[3]};
  ElseIf (n <= rounds)
    Physical Volume(Sprintf("round-%g", n)) = {solids[8], solids[9]};
    Physical Volume(Sprintf("lining-%g", n)) = {solids[0], solids[1], solids[2], solids[3]};
  Else
    rock[] += {solids[0], solids[1], solids[2], solids[3], solids[8], solids[9]};
  EndIf
EndFor
Physical Volume("rock") = rock[];

// The edges of the model, found by their place.
e = 0.001; w = 1000;
Physical Surface("symmetry") = Surface In BoundingBox{-e, -w, -w, e, w, w};
Physical Surface("side") = Surface In BoundingBox{side - e, -w, -w, side + e, w, w};
Physical Surface("back") = Surface In BoundingBox{-w, back - e, -w, w, back + e, w};
Physical Surface("front") = Surface In BoundingBox{-w, front - e, -w, w, front + e, w};
Physical Surface("bottom") = Surface In BoundingBox{-w, -w, -side - e, w, w, -side + e};
Physical Surface("top") = Surface In BoundingBox{-w, -w, side - e, w, w, side + e};
