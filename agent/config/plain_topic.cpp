#include "agent/config/plain_topic.h"

#include <algorithm>
#include <utility>

namespace fxagent {

tl::expected<PlainTopic, std::string> PlainTopic::parse(std::string_view text,
                                                        const std::string& root,
                                                        const std::string& id) {
  PlainTopic topic;
  bool has_tag = false;
  const auto add_text = [&topic](std::string_view part) {
    if (topic.pieces_.empty() || topic.pieces_.back().part != Part::text)
      topic.pieces_.push_back({});
    topic.pieces_.back().text += part;
  };
  while (!text.empty()) {
    const std::size_t brace = text.find('{');
    add_text(text.substr(0, brace));
    if (brace == text.npos) break;
    const std::size_t end = text.find('}', brace);
    if (end == text.npos) return tl::unexpected(std::string("has a { without a }"));
    const std::string_view name = text.substr(brace + 1, end - brace - 1);
    if (name == "root") {
      add_text(root);
    } else if (name == "id") {
      add_text(id);
    } else if (name == "device" || name == "group" || name == "tag") {
      const Part part =
          name == "device" ? Part::device : (name == "group" ? Part::group : Part::tag);
      topic.pieces_.push_back({part, ""});
      has_tag = has_tag || part == Part::tag;
    } else {
      return tl::unexpected("has {" + std::string(name) +
                            "}, and only {root}, {id}, {device}, {group}, {tag}, {site}, {area} "
                            "and {line} can be replaced");
    }
    text.remove_prefix(end + 1);
  }
  std::erase_if(topic.pieces_,
                [](const Piece& piece) { return piece.part == Part::text && piece.text.empty(); });
  if (!has_tag) return tl::unexpected(std::string("needs {tag}: each tag has a topic of its own"));
  std::string shape;
  for (const Piece& piece : topic.pieces_)
    shape += piece.part == Part::text ? piece.text : std::string("x");
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
  for (const Piece& piece : pieces_) {
    switch (piece.part) {
      case Part::text:
        topic += piece.text;
        break;
      case Part::device:
        topic += device;
        break;
      case Part::group:
        topic += group;
        break;
      case Part::tag:
        topic += tag;
        break;
    }
  }
  return topic;
}

/// A level with a place in it becomes `+` as a whole: a wildcard must stand alone.
std::string PlainTopic::filter() const {
  constexpr char kPlace = '\1';
  std::string shape;
  for (const Piece& piece : pieces_)
    shape += piece.part == Part::text ? piece.text : std::string(1, kPlace);
  std::string filter;
  std::size_t begin = 0;
  while (begin <= shape.size()) {
    const std::size_t end = std::min(shape.find('/', begin), shape.size());
    const std::string level = shape.substr(begin, end - begin);
    filter += (begin == 0 ? "" : "/") + (level.find(kPlace) == level.npos ? level : "+");
    begin = end + 1;
  }
  return filter;
}

}  // namespace fxagent
