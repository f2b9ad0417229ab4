// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

#include "view/export_record.h"
#include "view/page_files.h"

namespace forcegrid::view {

/// The page as one file that needs nothing else: its modules, three.js, dygraphs and styles are in
/// it, and the recording, compressed. A policy in it forbids everything from elsewhere.
/// @param largest_bytes  of the file; the record is thinned until it fits.
/// @throws ViewError if it does not fit even so, or if the page's files are not as they have to be.
/// Real-time: no. Threads: any.
std::string exported_page(const PageFiles& files, ExportRecord& record, std::size_t largest_bytes);

/// The page's files alone: index.html with everything in it but `recording`, which is base64.
std::string page_with(const PageFiles& files, const std::string& recording);

/// Whether the file can be made at all, before there is anything to write.
/// @throws ViewError naming it and the system's reason.
void check_export(const std::string& file);

/// Writes a file so that there is either all of it or what was there before.
/// @throws ViewError naming the file and the system's reason.
void write_export(const std::string& file, const std::string& text);

}  // namespace forcegrid::view
