// Controllers are linked in, so nothing is loaded by name; Debian has no pluginlib.
#pragma once
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace pluginlib {
template <class T>
struct ClassLoader {
  ClassLoader(const std::string&, const std::string&) {}
  bool isClassAvailable(const std::string&) { return false; }
  std::unique_ptr<T> createUniqueInstance(const std::string&) { return nullptr; }
  std::shared_ptr<T> createInstance(const std::string&) { return nullptr; }
  std::vector<std::string> getDeclaredClasses() { return {}; }
};
}  // namespace pluginlib
