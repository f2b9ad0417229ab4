// SPDX-License-Identifier: Apache-2.0
#include "cli/run/worker_processes.h"

#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <system_error>

#include "cli/common/stop_request.h"
#include "link/key.h"

namespace forcegrid::cli {
WorkerProcesses::WorkerProcesses(const std::vector<std::string>& key_files)
    : key_files_(key_files) {
  if (!key_files_.empty()) {
    return;
  }
  std::string folder = std::filesystem::temp_directory_path() / "forcegrid-key-XXXXXX";
  if (::mkdtemp(folder.data()) == nullptr) {
    throw std::runtime_error("workers: no folder for their key at " + folder + ": " +
                             std::generic_category().message(errno) +
                             "; make a key with 'forcegrid keygen FILE' and give --key FILE");
  }
  own_folder_ = folder;
  key_files_ = {folder + "/link.key"};
  link::LinkKey::generate(key_files_.front());
}

WorkerProcesses::~WorkerProcesses() {
  if (StopRequest::signal() != 0) {
    for (const auto& worker : workers_) {
      worker->terminate();  // all at the same time
    }
  }
  workers_.clear();
  remove_own_key();
}

void WorkerProcesses::remove_own_key() noexcept {
  std::error_code ignored;
  if (!own_folder_.empty()) {
    std::filesystem::remove_all(own_folder_, ignored);
  }
}

void WorkerProcesses::start(int count, const std::string& listening, const std::string& scene) {
  const std::string before = " workers ";
  const std::size_t at = listening.find(before);
  if (at == std::string::npos) {
    throw std::runtime_error("the simulator did not print the address for its workers: " +
                             listening);
  }
  const std::string address = listening.substr(at + before.size());
  for (int i = 0; i < count; ++i) {
    workers_.push_back(std::make_unique<ChildProcess>(
        std::vector<std::string>{"worker", "--connect", address, "--key", key_files_.front(),
                                 "--scene", scene, "--until-stdin-closes"},
        ChildOptions{.name = "worker " + std::to_string(i + 1)}));
  }
  for (const auto& worker : workers_) {
    static_cast<void>(worker->wait_until_started());
  }
  remove_own_key();  // all workers have read it, and a killed run could not remove it later
}

}  // namespace forcegrid::cli
