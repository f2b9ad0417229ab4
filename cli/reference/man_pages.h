// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

#include "cli/common/options.h"

namespace forcegrid::cli {

/// Manual pages in troff's man macros, made from the option tables: one of the program and one of
/// each of its commands, whose sub-commands are sections of it. No page depends on the time or the
/// machine.
///
/// @param program  with all commands
/// @param version  of the program, for the foot of each page
/// @returns file name ("forcegrid-run.1") and text
std::map<std::string, std::string> man_pages(const Command& program, const std::string& version);

}  // namespace forcegrid::cli
