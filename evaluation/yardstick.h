#pragma once

namespace forcegrid::evaluation {

/// [ns] What the least trilinear read takes on this machine now: eight aligned loads of four floats
/// and their weighted sum, at random places of a grid of 50^3 vertices (2 MB), without bounds or
/// status; the median over batches of 4,096 reads. Costs of queries are stated as multiples of it,
/// so that they can be compared between machines. Takes some 20 ms.
/// Real-time: no. Threads: any.
double bare_trilinear_read_ns();

}  // namespace forcegrid::evaluation
