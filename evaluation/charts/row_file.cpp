// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/row_file.h"

#include <sys/file.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "evaluation/objects/force_table.h"

namespace forcegrid::evaluation {
namespace {

using nlohmann::ordered_json;

constexpr char kNotFound[] = "";
constexpr const char* kRowsFile = "rows.jsonl";

std::string system_error() { return std::strerror(errno == 0 ? EIO : errno); }

}  // namespace

RowFile::RowFile(const std::filesystem::path& folder, const std::string& program,
                 const std::function<void(const ordered_json&)>& take)
    : file_name_(folder / kRowsFile), program_(program) {
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

std::size_t merge_rows(const std::filesystem::path& folder, const std::string& program,
                       const std::vector<std::filesystem::path>& from) {
  std::set<std::string> keys;
  RowFile rows(folder, program,
               [&keys](const ordered_json& row) { keys.insert(row.at("key").get<std::string>()); });
  std::size_t added = 0;
  for (const std::filesystem::path& shard : from) {
    const std::filesystem::path name = shard / kRowsFile;
    std::ifstream file(name);
    if (!file) {
      throw ChartError(name.string() + " can't be read; name the --out folders of the shards");
    }
    for (std::string line; std::getline(file, line);) {
      ordered_json row = ordered_json::parse(line, nullptr, false);
      if (row.is_discarded() || !row.is_object() || !row.contains("key")) {
        continue;  // the last line of a shard that was killed; the row is measured again
      }
      if (row.value("program", kNotFound) != program) {
        throw ChartError(name.string() +
                         " has rows of another program than this one; make all shards and merge "
                         "them with the same forcegrid-tools");
      }
      if (keys.insert(row.at("key").get<std::string>()).second) {
        rows.keep(std::move(row));
        ++added;
      }
    }
  }
  return added;
}

}  // namespace forcegrid::evaluation
