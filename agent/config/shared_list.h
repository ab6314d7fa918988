// Lists whose copies share the elements. Changing an element through one copy first gives that copy
// its own (copy on write). Several threads may read copies. Non-const access copies shared
// elements, so access a list that other threads read through const only.
#pragma once

#include <boost/iterator/indirect_iterator.hpp>
#include <cstddef>
#include <initializer_list>
#include <memory>
#include <utility>
#include <vector>

namespace fxagent {

/// Shares each element by itself: copying the list copies one pointer for each. References stay
/// valid as long as any copy has the element.
template <class T>
class SharedList final {
  // Owners: every copy of the list that has the element, and callers of shared().
  using Elements = std::vector<std::shared_ptr<T>>;

 public:
  using value_type = T;
  // Over the elements, not over the pointers to them.
  using iterator = boost::indirect_iterator<typename Elements::iterator>;
  using const_iterator = boost::indirect_iterator<typename Elements::const_iterator, const T>;

  SharedList() = default;
  SharedList(std::initializer_list<T> list) {
    for (const T& each : list) push_back(each);
  }

  std::size_t size() const { return elements_.size(); }
  bool empty() const { return elements_.empty(); }
  const T& operator[](std::size_t i) const { return *elements_[i]; }
  const T& at(std::size_t i) const { return *elements_.at(i); }
  const T& front() const { return *elements_.front(); }
  const T& back() const { return *elements_.back(); }
  const_iterator begin() const { return const_iterator(elements_.begin()); }
  const_iterator end() const { return const_iterator(elements_.end()); }
  /// Returns element `i` with shared ownership, for callers that need it longer than the list.
  std::shared_ptr<const T> shared(std::size_t i) const { return elements_.at(i); }
  /// True if both lists have the same object at `i`, not merely equal ones.
  bool shares(const SharedList& other, std::size_t i) const {
    return i < size() && i < other.size() && elements_[i] == other.elements_[i];
  }

  T& operator[](std::size_t i) { return own(elements_[i]); }
  T& at(std::size_t i) { return own(elements_.at(i)); }
  T& front() { return own(elements_.front()); }
  T& back() { return own(elements_.back()); }
  iterator begin() {
    own_all();
    return iterator(elements_.begin());
  }
  iterator end() {
    own_all();
    return iterator(elements_.end());
  }

  void reserve(std::size_t size) { elements_.reserve(size); }
  void push_back(T element) { elements_.push_back(std::make_shared<T>(std::move(element))); }
  T& emplace_back() { return *elements_.emplace_back(std::make_shared<T>()); }
  void pop_back() { elements_.pop_back(); }
  void clear() { elements_.clear(); }
  void resize(std::size_t size, const T& like = T()) {
    if (elements_.size() > size) elements_.resize(size);
    while (elements_.size() < size) push_back(like);
  }
  /// Makes element `of_other` of `other` the element `i` of this list too.
  void share(std::size_t i, const SharedList& other, std::size_t of_other) {
    elements_.at(i) = other.elements_.at(of_other);
  }

 private:
  static T& own(std::shared_ptr<T>& element) {
    if (element.use_count() > 1) element = std::make_shared<T>(*element);
    return *element;
  }
  void own_all() {
    for (auto& element : elements_) own(element);
  }

  Elements elements_;
};

/// Shares all elements together: copying the list copies one pointer, changing one element copies
/// all. References stay valid as long as any copy has the elements.
template <class T>
class SharedVector final {
  using Elements = std::vector<T>;

 public:
  using value_type = T;
  using iterator = typename Elements::iterator;
  using const_iterator = typename Elements::const_iterator;

  SharedVector() = default;
  SharedVector(std::initializer_list<T> list) : elements_(std::make_shared<Elements>(list)) {}

  std::size_t size() const { return all().size(); }
  bool empty() const { return all().empty(); }
  const T& operator[](std::size_t i) const { return all()[i]; }
  const T& at(std::size_t i) const { return all().at(i); }
  const T& front() const { return all().front(); }
  const T& back() const { return all().back(); }
  const_iterator begin() const { return all().begin(); }
  const_iterator end() const { return all().end(); }
  /// True if both have the same elements in memory, not merely equal ones.
  bool shares(const SharedVector& other) const { return elements_ == other.elements_; }
  friend bool operator==(const SharedVector& a, const SharedVector& b) {
    return a.shares(b) || a.all() == b.all();
  }

  T& operator[](std::size_t i) { return own()[i]; }
  T& at(std::size_t i) { return own().at(i); }
  T& front() { return own().front(); }
  T& back() { return own().back(); }
  iterator begin() { return own().begin(); }
  iterator end() { return own().end(); }

  void reserve(std::size_t size) { own().reserve(size); }
  void push_back(T element) { own().push_back(std::move(element)); }
  T& emplace_back() { return own().emplace_back(); }
  void pop_back() { own().pop_back(); }
  void clear() { elements_.reset(); }
  void resize(std::size_t size) { own().resize(size); }
  void assign(std::size_t size, const T& like) { own().assign(size, like); }

 private:
  const Elements& all() const {
    static const Elements none;
    return elements_ == nullptr ? none : *elements_;
  }
  Elements& own() {
    if (elements_ == nullptr)
      elements_ = std::make_shared<Elements>();
    else if (elements_.use_count() > 1)
      elements_ = std::make_shared<Elements>(*elements_);
    return *elements_;
  }

  std::shared_ptr<Elements> elements_;  ///< owners: all copies; nullptr if empty
};

}  // namespace fxagent
