// SPDX-License-Identifier: Apache-2.0
#include "evaluation/row_file.h"

#include <sys/file.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>

#include "evaluation/force_table.h"

namespace forcegrid::evaluation {
namespace {

using nlohmann::ordered_json;

constexpr char kNotFound[] = "";

std::string system_error() { return std::strerror(errno == 0 ? EIO : errno); }

}  // namespace

RowFile::RowFile(const std::filesystem::path& folder, const std::string& program,
                 const std::function<void(const ordered_json&)>& take)
    : file_name_(folder / "rows.jsonl"), program_(program) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) {
    throw ChartError("folder " + folder.string() + " can't be made (" + error.message() +
                     "); choose another one with --out");
  }
  const std::string lock_name = (folder / ".lock").string();
  errno = 0;
  lock_.reset(std::fopen(lock_name.c_str(), "w"));
  if (!lock_) {
    throw ChartError(lock_name + " can't be written (" + system_error() +
                     "); choose another folder with --out");
  }
  if (flock(fileno(lock_.get()), LOCK_EX | LOCK_NB) != 0) {
    throw ChartError("another chart is writing to " + folder.string() +
                     "; wait for it or choose another folder with --out");
  }
  std::string kept;
  {
    std::ifstream file(file_name_);
    for (std::string line; std::getline(file, line);) {
      const ordered_json json = ordered_json::parse(line, nullptr, false);
      if (json.is_discarded() || !json.is_object() ||
          json.value("program", kNotFound) != program_) {
        continue;
      }
      try {
        take(json);
        kept += line + '\n';
      } catch (const ordered_json::exception&) {
        // A damaged line; its row is measured again.
      }
    }
  }
  write_file(file_name_, kept);
  errno = 0;
  file_.reset(std::fopen(file_name_.c_str(), "a"));
  if (!file_) {
    throw ChartError(file_name_.string() + " can't be written (" + system_error() +
                     "); choose another folder with --out");
  }
}

void RowFile::keep(ordered_json row) {
  row["program"] = program_;
  const std::string line = row.dump() + '\n';
  errno = 0;
  const bool written = std::fwrite(line.data(), 1, line.size(), file_.get()) == line.size();
  if (std::fflush(file_.get()) != 0 || !written) {
    throw ChartError(file_name_.string() + ": " + system_error() +
                     "; free some space, then repeat the command to continue");
  }
}

}  // namespace forcegrid::evaluation
