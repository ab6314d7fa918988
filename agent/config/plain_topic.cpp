#include "agent/config/plain_topic.h"

#include <algorithm>
#include <map>

namespace fxagent {
namespace {

// Places of the names in the shape. No topic has control characters.
constexpr char kDevice = '\1';
constexpr char kGroup = '\2';
constexpr char kTag = '\3';
constexpr std::string_view kPlaces = "\1\2\3";

}  // namespace

tl::expected<PlainTopic, std::string> PlainTopic::parse(std::string_view text,
                                                        const std::string& root,
                                                        const std::string& id) {
  PlainTopic topic;
  std::string& shape = topic.shape_;
  const std::map<std::string_view, std::string> known{
      {"root", root}, {"id", id}, {"device", {kDevice}}, {"group", {kGroup}}, {"tag", {kTag}}};
  while (!text.empty()) {
    const std::size_t brace = text.find('{');
    shape += text.substr(0, brace);
    if (brace == text.npos) break;
    const std::size_t end = text.find('}', brace);
    if (end == text.npos) return tl::unexpected(std::string("has a { without a }"));
    const std::string_view name = text.substr(brace + 1, end - brace - 1);
    const auto put = known.find(name);
    if (put == known.end())
      return tl::unexpected("has {" + std::string(name) +
                            "}, and only {root}, {id}, {device}, {group}, {tag}, {site}, {area} "
                            "and {line} can be replaced");
    shape += put->second;
    text.remove_prefix(end + 1);
  }
  if (shape.find(kTag) == shape.npos)
    return tl::unexpected(std::string("needs {tag}: each tag has a topic of its own"));
  if (shape.find_first_of("+#") != shape.npos)
    return tl::unexpected(std::string("must not have the wildcards + and #"));
  if (shape.starts_with('/') || shape.ends_with('/') || shape.find("//") != shape.npos)
    return tl::unexpected(std::string("must not have an empty level"));
  if (shape.starts_with('$'))
    return tl::unexpected(std::string("must not begin with $, which belongs to the broker"));
  return topic;
}

std::string PlainTopic::of(std::string_view device, std::string_view group,
                           std::string_view tag) const {
  std::string topic;
  for (const char c : shape_) {
    if (c == kDevice)
      topic += device;
    else if (c == kGroup)
      topic += group;
    else if (c == kTag)
      topic += tag;
    else
      topic += c;
  }
  return topic;
}

/// A level with a place in it becomes `+` as a whole: a wildcard must stand alone.
std::string PlainTopic::filter() const {
  std::string filter;
  std::size_t begin = 0;
  while (begin <= shape_.size()) {
    const std::size_t end = std::min(shape_.find('/', begin), shape_.size());
    const std::string level = shape_.substr(begin, end - begin);
    filter += (begin == 0 ? "" : "/") + (level.find_first_of(kPlaces) == level.npos ? level : "+");
    begin = end + 1;
  }
  return filter;
}

}  // namespace fxagent
