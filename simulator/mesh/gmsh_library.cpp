// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/gmsh_library.h"

#include <dlfcn.h>

#include <utility>

#include "simulator/mesh/error.h"
#include "simulator/mesh/missing_part.h"

namespace forcegrid::simulator {
namespace {

constexpr char kLibrary[] = "libgmsh.so.4.8";
using gmshInitialize = void(int argc, char** argv, int read_configuration, int* error);
using gmshOptionSetNumber = void(const char* name, double value, int* error);
using gmshLoggerGetLastError = void(char** text, int* error);
using gmshFree = void(void* memory);
using gmshFinalize = void(int* error);

}  // namespace

void GmshLibrary::Close::operator()(void* library) const { ::dlclose(library); }

// libgmsh brings a CAD kernel and a window system and takes longer to load than the rest of the
// program takes to start, so it is loaded only here.
GmshLibrary::GmshLibrary(std::string who)
    : who_(std::move(who)), library_(::dlopen(kLibrary, RTLD_NOW | RTLD_LOCAL)) {
  if (!library_) {
    throw MissingPart(who_ + kLibrary + " can't be loaded (" + ::dlerror() +
                      "); install Debian's libgmsh4.8 or convert the file to .obj");
  }
  int error = 0;
  function<gmshInitialize>("gmshInitialize")(0, nullptr, 0, &error);
  require(error == 0, "libgmsh does not start");
  set_option("General.Terminal", 0.0);
}

GmshLibrary::~GmshLibrary() {
  int error = 0;
  // The constructor has refused a library without the others.
  if (void* const finalize = ::dlsym(library_.get(), "gmshFinalize")) {
    reinterpret_cast<gmshFinalize*>(finalize)(&error);
  }
}

void* GmshLibrary::symbol(const char* name) const {
  void* const found = ::dlsym(library_.get(), name);
  require(found != nullptr, std::string("libgmsh has no ") + name);
  return found;
}

void GmshLibrary::require(bool good, const std::string& problem) const {
  if (!good) {
    throw Error(who_ + problem + "; install Debian's libgmsh4.8 or convert the file to .obj");
  }
}

void GmshLibrary::set_option(const char* name, double value) const {
  int error = 0;
  function<gmshOptionSetNumber>("gmshOptionSetNumber")(name, value, &error);
  require(error == 0, std::string("libgmsh has no option ") + name);
}

std::string GmshLibrary::last_error() const {
  char* text = nullptr;
  int error = 0;
  function<gmshLoggerGetLastError>("gmshLoggerGetLastError")(&text, &error);
  const std::string result = text != nullptr ? text : "no reason given";
  release(text);
  return result;
}

void GmshLibrary::release(void* memory) const { function<gmshFree>("gmshFree")(memory); }

}  // namespace forcegrid::simulator
