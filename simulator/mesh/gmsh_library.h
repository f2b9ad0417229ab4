// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

namespace forcegrid::simulator {

/// Gmsh's C interface, version 4.8: libgmsh, loaded and started. Debian's header comes only with a
/// CAD kernel and its headers, which no build should need for a library that is loaded when a .msh
/// file is read; so a user of a function declares its type as Gmsh's reference manual has it.
/// Real-time: no. Threads: one at a time, since libgmsh has one state for the whole program.
class GmshLibrary {
 public:
  /// @param who  begins every message.
  /// Throws Error if libgmsh can't be loaded or does not start.
  explicit GmshLibrary(std::string who);
  ~GmshLibrary();
  GmshLibrary(const GmshLibrary&) = delete;
  GmshLibrary& operator=(const GmshLibrary&) = delete;

  /// Throws Error if libgmsh has no function of this name.
  template <typename Function>
  Function* function(const char* name) const {
    return reinterpret_cast<Function*>(symbol(name));
  }

  /// Throws Error with `problem` and the remedy, unless `good`.
  void require(bool good, const std::string& problem) const;
  void set_option(const char* name, double value) const;
  std::string last_error() const;
  /// Frees what a function has allocated.
  void release(void* memory) const;
  const std::string& who() const noexcept { return who_; }

 private:
  struct Close {
    void operator()(void* library) const;
  };

  void* symbol(const char* name) const;

  std::string who_;
  std::unique_ptr<void, Close> library_;
};

}  // namespace forcegrid::simulator
