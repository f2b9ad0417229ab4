#include "forcegrid/methods.h"

#include <stdexcept>

#include "forcegrid/affine_methods.h"
#include "forcegrid/forcegrid_method.h"
#include "forcegrid/hold_method.h"
#include "forcegrid/linear_method.h"
#include "forcegrid/rls_method.h"

namespace forcegrid {
namespace {

using Make = std::unique_ptr<ForceMethod> (*)(const MethodOptions&);

struct NamedMethod {
  const char* name;
  Make make;
};

template <typename Method>
std::unique_ptr<ForceMethod> plain(const MethodOptions& /*options*/) {
  return std::make_unique<Method>();
}

template <typename Method>
std::unique_ptr<ForceMethod> with_options(const MethodOptions& options) {
  return std::make_unique<Method>(options);
}

constexpr NamedMethod kMethods[] = {
    {"forcegrid", with_options<ForcegridMethod>},
    {"hold", plain<HoldMethod>},
    {"linear", plain<LinearMethod>},
    {"secant", plain<SecantMethod>},
    {"broyden", plain<BroydenMethod>},
    {"rls", plain<RlsMethod>},
    {"tangent", plain<TangentMethod>},
};

}  // namespace

const std::vector<std::string>& method_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const NamedMethod& method : kMethods) {
      all.emplace_back(method.name);
    }
    return all;
  }();
  return names;
}

std::string known_methods() {
  std::string text;
  for (const NamedMethod& method : kMethods) {
    text += (text.empty() ? "known methods: " : ", ") + std::string(method.name);
  }
  return text;
}

void check_method_name(const std::string& name) {
  for (const NamedMethod& method : kMethods) {
    if (name == method.name) {
      return;
    }
  }
  throw std::invalid_argument("method '" + name + "' is not known; " + known_methods());
}

std::unique_ptr<ForceMethod> make_force_method(const std::string& name,
                                               const MethodOptions& options) {
  check_method_name(name);
  for (const NamedMethod& method : kMethods) {
    if (name == method.name) {
      return method.make(options);
    }
  }
  return nullptr;
}

}  // namespace forcegrid
