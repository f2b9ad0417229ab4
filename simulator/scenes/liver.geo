// SPDX-License-Identifier: Apache-2.0
// A liver's rough shape in mm, made of ellipsoids: a large right lobe, a thin left one and a hollow
// underside. x toward the operator, y to the liver's left, z up. `make scenes` meshes it.
SetFactory("OpenCASCADE");
DefineConstant[ size_mm = 11.6 ];  // of an element's edge

Sphere(1) = {0, 0, 0, 1};
Dilate { {0, 0, 0}, {68, 82, 62} } { Volume{1}; }
Sphere(2) = {0, 0, 0, 1};
Dilate { {0, 0, 0}, {52, 105, 36} } { Volume{2}; }
Rotate { {1, 0, 0}, {0, 0, 0}, Pi / 14 } { Volume{2}; }
Translate { 6, 62, 14 } { Volume{2}; }
BooleanUnion(3) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
Sphere(4) = {30, 70, -95, 92};
BooleanDifference(5) = { Volume{3}; Delete; }{ Volume{4}; Delete; };
Physical Volume("parenchyma") = {5};

Mesh.MeshSizeMin = size_mm;
Mesh.MeshSizeMax = size_mm;
Mesh.MeshSizeFromPoints = 0;
Mesh.MeshSizeExtendFromBoundary = 0;
Mesh.Algorithm = 6;  // frontal, of the surface
Mesh.Optimize = 1;
Mesh.OptimizeThreshold = 0.4;  // improves elements of lower quality
