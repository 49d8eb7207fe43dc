// The section of a cavern, 20 m wide and 22 m high, dug as a heading and two benches.
//
// The mesh of the case:   gmsh -2 cavern.geo -o cavern.msh
// A finer one:            gmsh -2 cavern.geo -setnumber size 0.5 -o fine.msh
//
// Lengths in m: x across, y upwards, origin on the axis at the floor.

DefineConstant[ size = 1 ]; // factor on all element sizes

half = 10;        // half of the span
springing = 15;   // level at which the arch begins
crown = 22;
far = 90;         // from the axis to the sides of the model
bottom = -80; top = 100;

wall = 0.8 * size; // size of the elements at the wall
edge = 14 * size;  // and at the edges of the model
levels[] = {0, 6, 12, springing};

// The outline, point by point from the floor upwards, left and right.
For i In {0:3}
  l[i] = newp; Point(l[i]) = {-half, levels[i], 0, wall};
  r[i] = newp; Point(r[i]) = { half, levels[i], 0, wall};
EndFor
rise = crown - springing;
radius = (half^2 + rise^2) / (2 * rise);
centre = newp; Point(centre) = {0, crown - radius, 0, wall};
key = newp; Point(key) = {0, crown, 0, wall};

For i In {0:2}
  floors[i] = newl; Line(floors[i]) = {l[i], r[i]};
  lefts[i] = newl; Line(lefts[i]) = {l[i], l[i+1]};
  rights[i] = newl; Line(rights[i]) = {r[i], r[i+1]};
EndFor
arch[0] = newl; Circle(arch[0]) = {r[3], centre, key};
arch[1] = newl; Circle(arch[1]) = {key, centre, l[3]};

// What is dug together is one physical surface.
bench2 = newll; Curve Loop(bench2) = {floors[0], rights[0], -floors[1], -lefts[0]};
bench1 = newll; Curve Loop(bench1) = {floors[1], rights[1], -floors[2], -lefts[1]};
heading = newll; Curve Loop(heading) = {floors[2], rights[2], arch[0], arch[1], -lefts[2]};
loops[] = {heading, bench1, bench2};
For i In {0:2}
  dug[i] = news; Plane Surface(dug[i]) = {loops[i]};
EndFor
Physical Surface("heading") = dug[0];
Physical Surface("bench-1") = dug[1];
Physical Surface("bench-2") = dug[2];

// The rock around it, with names for the edges that are supported.
box[0] = newp; Point(box[0]) = {-far, bottom, 0, edge};
box[1] = newp; Point(box[1]) = { far, bottom, 0, edge};
box[2] = newp; Point(box[2]) = { far, top, 0, edge};
box[3] = newp; Point(box[3]) = {-far, top, 0, edge};
For i In {0:3}
  sides[i] = newl; Line(sides[i]) = {box[i], box[(i + 1) % 4]};
EndFor
outer = newll; Curve Loop(outer) = sides[];
profile = newll;
Curve Loop(profile) = {floors[0], rights[], arch[], -lefts[2], -lefts[1], -lefts[0]};
rock = news; Plane Surface(rock) = {outer, profile};
Physical Surface("rock") = rock;
Physical Curve("bottom") = sides[0];
Physical Curve("right") = sides[1];
Physical Curve("top") = sides[2];
Physical Curve("left") = sides[3];

Mesh.Algorithm = 6;
