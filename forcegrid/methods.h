#pragma once

#include <memory>
#include <string>
#include <vector>

#include "forcegrid/force_method.h"
#include "forcegrid/forcegrid_method.h"

namespace forcegrid {

/// Names that make_force_method knows, in the order in which people should meet them.
const std::vector<std::string>& method_names();

/// Makes a method by its name on the command line.
/// @param grid options of the grid methods; the others ignore them.
/// @throws std::invalid_argument for an unknown name (listing the known ones) or unusable options.
std::unique_ptr<ForceMethod> make_force_method(const std::string& name,
                                               const ForcegridMethod::Options& grid);

}  // namespace forcegrid
