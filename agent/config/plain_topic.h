// The topic of each tag in the profile `plain`, from its template. Pure.
#pragma once

#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

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
  enum class Part : unsigned char { text, device, group, tag };
  struct Piece {
    Part part = Part::text;
    std::string text;
  };
  std::vector<Piece> pieces_;
};

}  // namespace fxagent
