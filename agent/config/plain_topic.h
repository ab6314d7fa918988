// The topic of each tag in the profile `plain`, from its template. Pure.
#pragma once

#include <string>
#include <string_view>
#include <tl/expected.hpp>

namespace fxagent {

class PlainTopic final {
 public:
  /// Reads a template such as "{root}/{id}/{device}/{tag}". Returns what is wrong with it.
  static tl::expected<PlainTopic, std::string> parse(std::string_view text, const std::string& root,
                                                     const std::string& id);

  std::string of(std::string_view device, std::string_view group, std::string_view tag) const;
  /// Returns the filter that matches the topics of all tags.
  std::string filter() const;

 private:
  std::string shape_;  ///< the template, with a control character in place of each name
};

}  // namespace fxagent
